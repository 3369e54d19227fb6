// A path tracer in the contract of the harness's own, which numbers samples: so it can be asked for any of them, in
// passes of any size, and gates can judge it (`shader = "@file@"`).
// Check it with: @check@
@tracer@
// ------------------------------------------------------------------------------------------------------- Accumulation
// Adds `samples_per_pass` samples to the sum that `pingpong0` holds of the passes before; alpha counts them.
uniform sampler2D pingpong0;
uniform int numpass;                  // 0, 1, 2, ...
uniform int samples_per_pass = 16;
uniform uint first_sample = 0u;       // a pass's first sample is first_sample + numpass * samples_per_pass
uniform uint replica = 0u;            // an independent stream of samples for each

in vec2 texcoord;
layout(location = 0) out vec4 accumulated;

void main()
{
    ivec2 size = textureSize(pingpong0, 0);
    ivec2 pixel = ivec2(texcoord * vec2(size));
    // In pass 0 `pingpong0` holds whatever was left there, so it is not read.
    accumulated = numpass == 0 ? vec4(0.0) : texelFetch(pingpong0, pixel, 0);
    uint first = first_sample + uint(numpass) * uint(samples_per_pass);
    for (int i = 0; i < samples_per_pass; ++i)
        accumulated += vec4(sample_pixel(uvec2(pixel), vec2(size), (first + uint(i)) ^ (replica * 0x9e3779b9u)), 1.0);
}
