// What the generated scene says of a shape. In: input0 = point on it, shape id. Out: output0 = kd, exponent; output1 = ks,
// probability of the lobe; output2 = emission, 1 where the shape is two-sided; output3.rgb = environment.
#include "scene.glsl"

uniform sampler2D input0;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;
layout(location = 3) out vec4 output3;

void main()
{
    vec4 at = texelFetch(input0, ivec2(gl_FragCoord.xy), 0);
    int id = int(at.w);
    vec2 uv = surface_uv(id, at.xyz);
#if HAS_PROCEDURAL
    evaluate_procedural(id, at.xyz);
#endif
    Material m = material(id, at.xyz, uv);
    output0 = vec4(m.kd, m.alpha);
    output1 = vec4(m.ks, m.p_glossy);
    output2 = vec4(0.0);
#if HAS_EMISSION
    output2.rgb = emission(id, at.xyz, uv);
#endif
#if HAS_TWO_SIDED
    output2.a = float(is_two_sided(id));
#endif
    output3 = vec4(environment(vec3(0.0, 0.0, 1.0)), 0.0);
}
