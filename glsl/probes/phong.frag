// The BRDF's value for two directions, and one draw by STRATEGY. In: input0 = normal; input1 = v, to the viewer;
// input2 = l, to the light. Out: output0.rgb = f(l, v); output1.xyz = the drawn direction; output2.rgb = its weight.
// Each row draws from a stream of its own; where ROWS_ARE_SAMPLES is 1, from that of a sample of its own of one pixel.
#include "lib/phong.glsl"

#ifndef ROWS_ARE_SAMPLES
#define ROWS_ARE_SAMPLES 0
#endif

uniform sampler2D input0;
uniform sampler2D input1;
uniform sampler2D input2;
uniform vec3 kd;
uniform vec3 ks;
uniform float alpha;
uniform float p_glossy;
uniform uint replica;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec3 n = texelFetch(input0, row, 0).xyz;
    vec3 v = texelFetch(input1, row, 0).xyz;
    vec3 l = texelFetch(input2, row, 0).xyz;
    Material m = Material(kd, ks, alpha, p_glossy);
    output0 = vec4(eval_phong(m, dot(2.0 * dot(n, v) * n - v, l)), 0.0);

    vec3 drawn;
#if ROWS_ARE_SAMPLES
    seed_sample(pixel_stream(uvec2(37u, 11u), replica), uint(row.y * 1024 + row.x));
#else
    seed_sample(pixel_stream(uvec2(row), replica), 0u);
#endif
    vec3 weight = sample_phong(m, n, v, drawn);
    output1 = vec4(drawn, 0.0);
    output2 = vec4(weight, 0.0);
}
