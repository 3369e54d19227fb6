// Directions drawn from an image, in its own space. In: input0 = pick, u; input1 = a unit direction. Out: output0 = the
// direction drawn, its pdf; output1 = the radiance from there; output2 = radiance and pdf of input1.
#include "lib/environment.glsl"

uniform sampler2D input0;
uniform sampler2D input1;
uniform sampler2D image;
uniform sampler2D table;
uniform vec4 size;  // columns and rows, of the image and of the table

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec3 numbers = texelFetch(input0, row, 0).xyz;
    vec3 l = sample_environment_texel(table, size, numbers.x, numbers.yz);
    output1 = environment_texel(image, size.y, l);
    output0 = vec4(l, output1.a);
    output2 = environment_texel(image, size.y, texelFetch(input1, row, 0).xyz);
}
