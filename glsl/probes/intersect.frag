// Where a ray meets the scene. In: input0 = origin, reach; input1 = direction, and what set_time takes. Out: output0 =
// unit normal, distance (NO_HIT where it escapes); output1 = emission towards the ray's origin, shape id (-1 where it
// escapes).
#include "scene.glsl"

uniform sampler2D input0;
uniform sampler2D input1;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec4 origin = texelFetch(input0, row, 0);
    vec4 direction = texelFetch(input1, row, 0);
    vec3 d = direction.xyz;
#if HAS_MOTION
    set_time(direction.w);
#endif
    int id;
    float t = intersect_scene(origin.xyz, d, origin.w, id);
    vec3 p = origin.xyz + t * d;
#if HAS_MOTION
    p = to_rest(id, p);
#endif
    vec3 n = id < 0 ? vec3(0.0) : surface_normal(id, p);
#if HAS_MOTION
    n = from_rest(id, n);
#endif
    output0 = vec4(n, t);
    output1 = vec4(vec3(0.0), float(id));
#if HAS_PROCEDURAL
    evaluate_procedural(id, p);
#endif
#if HAS_EMISSION
    if (dot(n, d) < 0.0)
        output1.rgb = emission(id, p, surface_uv(id, p));
#endif
}
