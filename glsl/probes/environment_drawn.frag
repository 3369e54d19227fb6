// Directions that a scene draws from its environment map. In: input0 = pick, u; input1 = a unit direction. Out: output0 =
// the direction drawn, its pdf; output1.rgb = the radiance from there; output1.a = the pdf of input1.
#include "scene.glsl"

uniform sampler2D input0;
uniform sampler2D input1;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec3 numbers = texelFetch(input0, row, 0).xyz;
    float pdf;
    vec3 l = sample_environment(numbers.x, numbers.yz, pdf);
    output0 = vec4(l, pdf);
    output1 = vec4(environment(l), pdf_environment(texelFetch(input1, row, 0).xyz));
}
