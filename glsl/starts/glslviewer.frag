#version 330
// A path tracer for glslViewer: `glslViewer @file@`. The file is compiled twice, once for its buffer, which is
// drawn from what it held before (DOUBLE_BUFFER_0), and once for the window.
// Check it with: @check@
uniform sampler2D u_doubleBuffer0;
uniform vec2 u_resolution;
uniform int u_frame;
out vec4 fragColor;

@tracer@
void main()
{
#ifdef DOUBLE_BUFFER_0
    // --------------------------------------------------------------------------------------------------- Accumulation
    // One sample a frame, added to the sum of those before; alpha counts them.
    vec4 past = u_frame == 0 ? vec4(0.0) : texelFetch(u_doubleBuffer0, ivec2(gl_FragCoord.xy), 0);
    fragColor = past + vec4(sample_pixel(uvec2(gl_FragCoord.xy), u_resolution, uint(u_frame)), 1.0);
#else
    // The mean of what was summed, encoded for a display (sRGB).
    vec4 sum = texelFetch(u_doubleBuffer0, ivec2(gl_FragCoord.xy), 0);
    vec3 c = clamp(sum.rgb / sum.a, 0.0, 1.0);
    fragColor = vec4(mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308))), 1.0);
#endif
}
