// Value noise and its fractal sums at one point. In: input0 = the point, number of octaves; input1 = lacunarity, gain,
// the seed's upper and lower 16 bits. Out: output0 = gradient and value of the noise; output1.xy = value noise, fbm.
#include "lib/noise.glsl"

uniform sampler2D input0;
uniform sampler2D input1;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec4 place = texelFetch(input0, row, 0);
    vec4 how = texelFetch(input1, row, 0);
    int octaves = int(place.w);
    uint seed = uint(how.z) << 16u | uint(how.w);
    output0 = cell_noise_gradient(place.xyz, seed) * NOISE_UNIT;
    output1 = vec4(value_noise(place.xyz, seed), fbm(place.xyz, octaves, how.x, how.y, seed), 0.0, 0.0);
}
