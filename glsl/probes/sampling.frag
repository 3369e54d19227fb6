// One sampler and its pdf; SAMPLER is 0 for uniform, 1 for cosine, 2 for the lobe. In: input0 = axis, exponent;
// input1.xy = the sampler's two uniform numbers. Out: output0 = direction, its pdf.
#include "lib/sampling.glsl"

uniform sampler2D input0;
uniform sampler2D input1;

layout(location = 0) out vec4 output0;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec4 axis = texelFetch(input0, row, 0);
    vec2 u = texelFetch(input1, row, 0).xy;
#if SAMPLER == 0
    vec3 l = sample_uniform(axis.xyz, u);
    float pdf = pdf_uniform(dot(axis.xyz, l));
#elif SAMPLER == 1
    vec3 l = sample_cosine(axis.xyz, u);
    float pdf = pdf_cosine(dot(axis.xyz, l));
#else
    vec3 l = sample_lobe(axis.xyz, axis.w, u);
    float pdf = pdf_lobe(dot(axis.xyz, l), axis.w);
#endif
    output0 = vec4(l, pdf);
}
