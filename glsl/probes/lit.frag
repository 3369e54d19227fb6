// What the functions of light sampling make of the vertices of paths, each by itself: the light that is chosen, the way
// there, its density, what the surface answers, the weights, and what comes back. In: input0 = origin off the surface, key of
// the vertex's numbers; input1 = normal, p_glossy; input2 = direction to the viewer, alpha; input3 = kd; input4 = ks.
// `moment`, in [0, 1), of the shutter's interval. Out: by `part`.
//
// 0: output0 = l of aim_at_light, light; 1 = its weight, least; 2 = l of sample_light, pdf; 3 = light that was chosen, its
//    chance, least, pdf_bsdf of l; 4 = eval_bsdf of it, pdf_phong; 5 = what the ray meets: shape, distance, cosine, density
//    with which lights are sampled there; 6 = what that sends back, if it is the light; weight of the light's sample;
//    7 = light_reached for a weight of 1, weight of the direction's sample.
// 1: output0 = numbers: of the choice, of the map, of the direction; 1 = light_reached of another shape; 2 = the same of
//    something nearer than `least`; 3 = the same of the light farther on, less what that sends back; 4 = l of sample_bsdf,
//    pdf; 5 = pdf_bsdf and pdf_phong of it, cosine; 6 = eval_phong of l.
#include "scene.glsl"
#include "lib/path.glsl"

uniform sampler2D input0;
uniform sampler2D input1;
uniform sampler2D input2;
uniform sampler2D input3;
uniform sampler2D input4;
uniform float moment;
uniform int part;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;
layout(location = 3) out vec4 output3;
layout(location = 4) out vec4 output4;
layout(location = 5) out vec4 output5;
layout(location = 6) out vec4 output6;
layout(location = 7) out vec4 output7;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec4 origin = texelFetch(input0, row, 0);
    vec4 normal = texelFetch(input1, row, 0);
    vec4 viewer = texelFetch(input2, row, 0);
    Material m = Material(texelFetch(input3, row, 0).xyz, texelFetch(input4, row, 0).xyz, viewer.w, normal.w);
    vec3 o = origin.xyz, n = normal.xyz, v = viewer.xyz;
    uvec2 stream = pixel_stream(uvec2(uint(origin.w), 0u), 77u);
#if HAS_MOTION
    set_time(moment);
#endif
    seed_sample(stream, 0u);
    LightRay ray = aim_at_light(m, o, n, v);

    // The same numbers again, in the same order.
    seed_sample(stream, 0u);
    float choice = 0.0, pick = 0.0;
#if HAS_LIGHT_CHOICE
    choice = rand();
#endif
#if HAS_SKY_LIGHT && HAS_ENVIRONMENT_MAP
    pick = rand();
#endif
    vec2 u = rand2();
    float chance = 1.0;
    int light = choose_light(choice, chance);
    LightSample found = sample_light(light, o, n, pick, u);
    LightRay one = LightRay(found.l, vec3(1.0), light, found.least);

    if (part == 0) {
        int id;
        float t = intersect_scene(o, found.l, NO_HIT, id);
        vec3 p = o + t * found.l;
#if HAS_MOTION
        p = to_rest(id, p);
#endif
        vec3 across = id < 0 ? vec3(0.0) : surface_normal(id, p);
#if HAS_MOTION
        across = from_rest(id, across);
#endif
        float facing = -dot(across, found.l);
        vec4 met = vec4(float(id), t, facing, 0.0);
        float answer = 0.0, own = 1.0, other = 0.0;
#if LIGHTS == LIGHTS_MIS
        answer = pdf_bsdf(m, n, v, found.l);
        own = mis_weight(chance * found.pdf, answer);
        other = mis_weight(answer, chance * found.pdf);
#if HAS_SHAPE_LIGHTS
        if (id >= 0)
            met.w = met_light_pdf(id, o, t, facing);
#endif
#if HAS_SKY_LIGHT
        if (id < 0)
            met.w = environment_light_pdf(found.l);
#endif
#endif
        output0 = vec4(ray.l, float(ray.light));
        output1 = vec4(ray.weight, ray.least);
        output2 = vec4(found.l, found.pdf);
        output3 = vec4(float(light), chance, found.least, answer);
        output4 = vec4(eval_bsdf(m, n, v, found.l), pdf_phong(m, n, v, found.l));
        output5 = met;
        vec3 sent = vec3(0.0);
#if HAS_SKY_LIGHT
        if (id == light && id < 0)
            sent = environment(found.l);
#endif
#if HAS_SHAPE_LIGHTS
        if (id == light && id >= 0)
            sent = light_radiance(id, o + t * found.l, found.l);
#endif
        output6 = vec4(sent, own);
        output7 = vec4(light_reached(one, o, id, t), other);
    } else {
        int another = light == 0 ? 1 : 0;
        float farther = 1.0 + 2.0 * found.least;
        vec3 sent = vec3(0.0);
#if HAS_SKY_LIGHT
        if (light < 0)
            sent = environment(found.l);
#endif
#if HAS_SHAPE_LIGHTS
        if (light >= 0)
            sent = light_radiance(light, o + farther * found.l, found.l);
#endif
        Scatter drawn = sample_bsdf(m, n, v);
        float drawn_pdf = 0.0, bsdf_pdf = 0.0;
#if LIGHTS == LIGHTS_MIS
        drawn_pdf = drawn.pdf;
        bsdf_pdf = pdf_bsdf(m, n, v, drawn.l);
#endif
        output0 = vec4(choice, pick, u);
        output1 = vec4(light_reached(one, o, another, farther), 0.0);
        output2 = vec4(light_reached(one, o, light, 0.5 * found.least), 0.0);
        output3 = vec4(light_reached(one, o, light, farther) - sent, 0.0);
        output4 = vec4(drawn.l, drawn_pdf);
        output5 = vec4(bsdf_pdf, pdf_phong(m, n, v, drawn.l), dot(n, drawn.l), 0.0);
        output6 = vec4(eval_phong(m, dot(2.0 * dot(n, v) * n - v, found.l)), 0.0);
        output7 = vec4(0.0);
    }
}
