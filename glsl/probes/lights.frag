// One direction to a light, and the density of any direction. In: input0 = origin, number that chooses the light; input1 =
// the normal there, what set_time takes; input2 = the two numbers of the direction, the map's number; input3 = a direction,
// 0 for the one that is drawn. Out: output0 = direction, its density without the chance of the light; output1 = the light
// that was chosen, its chance, the least distance, 0; output2 = what the ray meets: shape, distance, cosine, and the
// density with which lights are sampled there, their chances in it; 0 where nothing shines.
#include "scene.glsl"

uniform sampler2D input0;
uniform sampler2D input1;
uniform sampler2D input2;
uniform sampler2D input3;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec4 origin = texelFetch(input0, row, 0);
    vec4 normal = texelFetch(input1, row, 0);
    vec4 u = texelFetch(input2, row, 0);
    vec3 asked = texelFetch(input3, row, 0).xyz;
#if HAS_MOTION
    set_time(normal.w);
#endif
    float chance;
    int light = choose_light(origin.w, chance);
    LightSample found = sample_light(light, origin.xyz, normal.xyz, u.z, u.xy);
    output0 = vec4(found.l, found.pdf);
    output1 = vec4(float(light), chance, found.least, 0.0);

    vec3 d = asked == vec3(0.0) ? found.l : asked;
    int id;
    float t = intersect_scene(origin.xyz, d, NO_HIT, id);
    vec3 p = origin.xyz + t * d;
#if HAS_MOTION
    p = to_rest(id, p);
#endif
    vec3 n = id < 0 ? vec3(0.0) : surface_normal(id, p);
#if HAS_MOTION
    n = from_rest(id, n);
#endif
    float facing = -dot(n, d);
    float pdf = 0.0;
#if LIGHTS == 2
    if (id >= 0 && facing > 0.0)
        pdf = met_light_pdf(id, origin.xyz, t, facing);
#endif
    output2 = vec4(float(id), t, facing, pdf);
}
