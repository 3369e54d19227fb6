// The parts of textures. In: input0 = a place q, a number t; input1.xy = y and x of an angle. Out: output0 = angle in
// turns, in whole turns, the radius of wood's rings, ramp_step of t between stops 1 and 2 of 3; output1 = wave of t that
// rises over 0.75, mirrored coordinates of q; output2 = marble, output3 = wood, of noise (0.1, 0.2, -0.3, 0.4) and
// distortion 2; output4.x = whether a checkerboard has its first colour at q.
#include "lib/uv.glsl"
#include "lib/procedural.glsl"
#include "lib/bitmaps.glsl"

uniform sampler2D input0;
uniform sampler2D input1;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;
layout(location = 3) out vec4 output3;
layout(location = 4) out vec4 output4;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec4 at = texelFetch(input0, row, 0);
    vec2 angle = texelFetch(input1, row, 0).xy;
    vec4 noise = vec4(0.1, 0.2, -0.3, 0.4);
    output0 = vec4(turns(angle.x, angle.y), whole_turns(angle.x, angle.y), wood_radius(at.xyz), ramp_step(at.w, 2.0, 1.0));
    output1 = vec4(wave(at.w, 0.75), mirrored(at.xy));
    output2 = marble(at.xyz, noise, 2.0);
    output3 = wood(at.xyz, noise, 2.0);
    output4 = vec4(is_first_color(at.xy), 0.0, 0.0, 0.0);
}
