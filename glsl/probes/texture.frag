// Textures over (u, v). In: input0 = u, v, shape id. Out: output0 = kd, exponent; output1 = ks, probability of the lobe;
// output2.rgb = emission.
#include "scene.glsl"

uniform sampler2D input0;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;

void main()
{
    vec3 at = texelFetch(input0, ivec2(gl_FragCoord.xy), 0).xyz;
    int id = int(at.z);
    Material m = material(id, vec3(0.0), at.xy);
    output0 = vec4(m.kd, m.alpha);
    output1 = vec4(m.ks, m.p_glossy);
    output2 = vec4(0.0);
#if HAS_EMISSION
    output2.rgb = emission(id, vec3(0.0), at.xy);
#endif
}
