// The random numbers of one sample of one pixel. In: input0 = pixel x and y, replica; input1.xy = the sample's index,
// its upper and lower 16 bits. Out: output0, 1 = its first eight numbers; output2.xy = the generator's seed, as its
// upper and lower 16 bits.
#include "lib/random.glsl"

uniform sampler2D input0;
uniform sampler2D input1;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    uvec3 place = uvec3(texelFetch(input0, row, 0).xyz);
    uvec2 index = uvec2(texelFetch(input1, row, 0).xy);
    seed_sample(pixel_stream(place.xy, place.z), index.x << 16u | index.y);
    output2 = vec4(rng_state >> 16u, rng_state & 0xffffu, 0.0, 0.0);
    output0 = vec4(rand(), rand(), rand(), rand());
    output1 = vec4(rand(), rand(), rand(), rand());
}
