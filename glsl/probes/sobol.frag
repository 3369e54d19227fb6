// The numbers of one sample of one pixel, as a path asks for them. In: input0 = pixel x and y, replica; input1.xy = the
// sample's index, its upper and lower 16 bits. Out: output0 = two pairs; output1 = a number, a pair, a number.
#include "lib/random.glsl"

uniform sampler2D input0;
uniform sampler2D input1;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    uvec3 place = uvec3(texelFetch(input0, row, 0).xyz);
    uvec2 index = uvec2(texelFetch(input1, row, 0).xy);
    seed_sample(pixel_stream(place.xy, place.z), index.x << 16u | index.y);
    output0.xy = rand2();
    output0.zw = rand2();
    output1.x = rand();
    output1.yz = rand2();
    output1.w = rand();
}
