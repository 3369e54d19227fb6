// The three pdfs. In: input0 = cosine to the axis, exponent. Out: output0.xyz = pdf_uniform, pdf_cosine, pdf_lobe.
#include "lib/sampling.glsl"

uniform sampler2D input0;

layout(location = 0) out vec4 output0;

void main()
{
    vec2 at = texelFetch(input0, ivec2(gl_FragCoord.xy), 0).xy;
    output0 = vec4(pdf_uniform(at.x), pdf_cosine(at.x), pdf_lobe(at.x, at.y), 0.0);
}
