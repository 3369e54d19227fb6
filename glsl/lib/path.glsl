// The estimator: L = 1/N Σ f(l,v) Li(l) (n·l) / pdf(l), unrolled along a path. Emission is gathered where a path
// meets it, the environment where a path escapes. Where LIGHTS is not 0, every vertex also sends a ray to one light.
#ifndef LIB_PATH
#define LIB_PATH

#include "lib/random.glsl"
#include "lib/camera.glsl"
#include "lib/bsdf.glsl"
#include "lib/interface.glsl"

// Lifts a scattered ray's origin off its surface. Mitsuba's own offset, SurfaceInteraction::offset_p: 1500 units
// of half the float32 spacing at 1, scaled with the point's magnitude. A tenth of it darkens by 3e-4 (self-hits).
const float RAY_EPSILON = 8.94e-5;

vec3 offset_origin(vec3 p, vec3 n)
{
    vec3 magnitude = abs(p);
    return p + n * (RAY_EPSILON * (1.0 + max(max(magnitude.x, magnitude.y), magnitude.z)));
}

// By bits, because a compiler may assume that comparisons with NaN do not happen.
bool is_finite(vec3 v)
{
    return all(notEqual(floatBitsToUint(v) & 0x7f800000u, uvec3(0x7f800000u)));
}

// Iterations that one path takes at most: see trace_samples.
#if HAS_DISPLACED
#define PATH_ITERATIONS (MAX_DEPTH * (1 + MAX_MARCH_STEPS) * (LIGHTS == LIGHTS_MET ? 1 : 2))
#else
#define PATH_ITERATIONS MAX_DEPTH
#endif

// Two ways to keep the next ray from waiting, with the same bits. Each takes for granted what our own files do; where a
// library has another in their place, it defines them as 0 (harness/shader/library.py).
//
// ENDS_BY_DIRECTION: a direction above the surface has weight, which is known before the powers that are in it. (Where
// nothing is glossy the weight is kd, and there as soon.) 19 % faster with AVX-512, no slower without.
#ifndef ENDS_BY_DIRECTION
#define ENDS_BY_DIRECTION HAS_GLOSSY
#endif
// STARTS_AHEAD: beside every vertex of a path the camera ray of the pixel's next sample is made, and taken where the path
// ends. The two paths share the generator, of which rng_state must be all the state. 11 % faster with the 32 registers of
// AVX-512; with 16 up to 4 % slower, so it is for the device to define this as 1 (harness/gpu/device.py). Not where
// spheres are displaced: most iterations are then steps of a march.
#if !defined(STARTS_AHEAD) || HAS_DISPLACED
#undef STARTS_AHEAD
#define STARTS_AHEAD 0
#endif

// The camera ray of sample first + number of a pixel, and the generator as it stands behind it.
void start_path(uvec2 stream, uint first, int number, uvec2 pixel, vec2 pixel_size, out vec3 o, out vec3 d, out float reach)
{
    seed_sample(stream, first + uint(number));
#if HAS_LENS
    lens_ray((vec2(pixel) + rand2()) * pixel_size, rand2(), o, d, reach);
#else
    camera_ray((vec2(pixel) + rand2()) * pixel_size, o, d, reach);
#endif
}

// Whether a path goes on from shape `id` along l. One whose throughput became zero as red times green goes on by
// direction as well, and brings nothing.
bool goes_on(int id, vec3 n, vec3 l, vec3 throughput)
{
#if ENDS_BY_DIRECTION
    return !(dot(n, l) <= 0.0) && !is_black(id);  // what is not a number goes on, to be left out
#else
    return any(notEqual(throughput, vec3(0.0)));
#endif
}

#if LIGHTS
// A ray from a vertex to one light: where it goes, which light it must meet first and no nearer than `least`, and what the
// light's radiance is then multiplied by.
struct LightRay {
    vec3 l;
    vec3 weight;
    int light;
    float least;
};

// Draws a light and a direction to it from o, which was lifted off a surface; v points to the viewer.
LightRay aim_at_light(Material m, vec3 o, vec3 n, vec3 v)
{
    float chance = 1.0;
#if HAS_LIGHT_CHOICE
    int light = choose_light(rand(), chance);
#else
    int light = choose_light(0.0, chance);
#endif
#if HAS_SKY_LIGHT && HAS_ENVIRONMENT_MAP
    float pick = rand();
#else
    float pick = 0.0;
#endif
    LightSample found = sample_light(light, o, n, pick, rand2());
    float pdf = chance * found.pdf;
    float cos_l = dot(n, found.l);
    vec3 weight = vec3(0.0);
    if (cos_l > 0.0 && pdf > 0.0) {
        weight = eval_bsdf(m, n, v, found.l) * (cos_l / pdf);
#if LIGHTS == LIGHTS_MIS
        weight *= mis_weight(pdf, pdf_bsdf(m, n, v, found.l));
#endif
    }
    return LightRay(found.l, weight, light, found.least);
}

// What the ray from o gathers that met shape `id` at the distance t.
vec3 light_reached(LightRay ray, vec3 o, int id, float t)
{
    if (id != ray.light || t < ray.least)
        return vec3(0.0);
#if HAS_SHAPE_LIGHTS && HAS_SKY_LIGHT
    return ray.weight * (id < 0 ? environment(ray.l) : light_radiance(id, o + t * ray.l, ray.l));
#elif HAS_SHAPE_LIGHTS
    return ray.weight * light_radiance(id, o + t * ray.l, ray.l);
#else
    return ray.weight * environment(ray.l);
#endif
}
#endif

// What counts of the light that a path meets by itself at its vertex number `vertex`: all of it at the first, which no
// light ray of an earlier one has seen; nothing, or what the heuristic leaves, where one might have.
#if LIGHTS == LIGHTS_NEE
#define OF_MET_LIGHT(pdf_of_lights) float(vertex == 1)
#elif LIGHTS == LIGHTS_MIS
#define OF_MET_LIGHT(pdf_of_lights) (vertex == 1 ? 1.0 : mis_weight(direction_pdf, pdf_of_lights))
#endif

// Adds samples first … first+samples-1 of one pixel to `sum`: rgb is the sum of radiance, alpha the number of samples
// in it. A sample that is not finite is left out of both, so alpha tells how many there were. Adding to the sum so
// far, one sample after another, gives the same bits however the samples are divided into passes.
//
// One flat loop: a lane whose path ends starts its next sample at once, so lanes that run in lockstep do not wait
// for the longest path of each sample. MAX_DEPTH vertices at most per path bound the loop; where spheres are displaced,
// each iteration takes a ray one step farther, so that lanes do not wait for the longest march either.
vec4 trace_samples(vec4 sum, uvec2 pixel, vec2 size, uint replica, uint first, int samples)
{
    uvec2 stream = pixel_stream(pixel, replica);
    vec2 pixel_size = 1.0 / size;
    vec3 o, d, radiance, throughput;
    float reach;
#if LIGHTS == LIGHTS_MIS
    float direction_pdf = 0.0;  // with which d was drawn
#endif
    int vertex = 0;      // of the current path; 0 means that a new one is due
    int finished = 0;
#if HAS_DISPLACED
    bool marching = false;  // the current ray's march is not at its end
#if LIGHTS
    bool lighting = false;  // the current ray is a vertex's to a light, `aim`
    bool goes = false;      // whether the path goes on after it, along `scattered`
    LightRay aim;
    vec3 scattered;
#endif
#endif
#if STARTS_AHEAD
    start_path(stream, first, 0, pixel, pixel_size, o, d, reach);
#endif
    for (int i = 0; i < samples * PATH_ITERATIONS; ++i) {
#if STARTS_AHEAD
        uint state = rng_state;
        vec3 next_o, next_d;
        float next_reach;
        start_path(stream, first, finished + 1, pixel, pixel_size, next_o, next_d, next_reach);
        uint next_state = rng_state;
        rng_state = state;
#endif
        if (vertex == 0) {
#if !STARTS_AHEAD
            start_path(stream, first, finished, pixel, pixel_size, o, d, reach);
#endif
#if HAS_MOTION
            set_time(rand());
#endif
            radiance = vec3(0.0);
            throughput = vec3(1.0);
        }
#if HAS_DISPLACED
        if (!marching) {
#if LIGHTS
            if (!lighting)
#endif
            ++vertex;
            int met;
            float nearest = intersect_shapes(o, d, reach, met);
            begin_march(nearest, met);
        }
        marching = march_on(o, d);
        if (marching)
            continue;
        float t = march.t;
        int id = march.id;
#else
        ++vertex;

        int id;
        float t = intersect_scene(o, d, reach, id);
#endif
        bool alive = false;
#if LIGHTS && HAS_DISPLACED
        bool lit = lighting;
        if (lighting) {
            radiance += light_reached(aim, o, id, t);
            lighting = false;
            d = scattered;
            alive = goes;
        } else
#endif
        if (id < 0) {
#if HAS_ENVIRONMENT_MAP
#elif HAS_SKY_LIGHT
            radiance += throughput * (environment(d) * OF_MET_LIGHT(0.0));
#else
            radiance += throughput * environment(d);
#endif
        } else {
            vec3 p = o + t * d;
            vec3 rest = p;  // where p is on the shape at rest: normals and textures are those of that place
#if HAS_MOTION
            rest = to_rest(id, p);
#endif
            vec3 n = surface_normal(id, rest);
#if HAS_PROJECTION
            vec3 met = project_hit(id, rest, n);
#if HAS_MOTION
            p += from_rest(id, met - rest);
#else
            p = met;
#endif
            rest = met;
#endif
            vec2 uv = surface_uv(id, rest);
#if HAS_MOTION
            n = from_rest(id, n);
#endif
#if HAS_PROCEDURAL
            evaluate_procedural(id, rest);
#endif
#if BITMAPS_AHEAD
            look_up_bitmaps(id, uv);
#endif
            float facing = -dot(n, d);
#if HAS_EMISSION
            if (facing > 0.0)
#if HAS_SHAPE_LIGHTS
                radiance += throughput * (emission(id, rest, uv) * OF_MET_LIGHT(met_light_pdf(id, o, t, facing)));
#else
                radiance += throughput * emission(id, rest, uv);
#endif
#endif
#if HAS_TWO_SIDED
            if (facing < 0.0 && is_two_sided(id)) {
                n = -n;
                facing = -facing;
            }
#endif
            if (facing > 0.0 && vertex < MAX_DEPTH) {
#if LIGHTS
                LightRay ray = aim_at_light(material(id, rest, uv), offset_origin(p, n), n, -d);
                ray.weight *= throughput;
#endif
                Scatter drawn = sample_bsdf(material(id, rest, uv), n, -d);
                throughput *= drawn.weight;
#if LIGHTS == LIGHTS_MIS
                direction_pdf = drawn.pdf;
#endif
                o = offset_origin(p, n);
                d = drawn.l;
                reach = NO_HIT;
                alive = goes_on(id, n, drawn.l, throughput);
#if LIGHTS == LIGHTS_NEE
                alive = alive && vertex + 1 < MAX_DEPTH;  // what the last ray would meet has been sampled
#endif
#if LIGHTS && HAS_DISPLACED
                if (ray.weight != vec3(0.0)) {  // the light's ray is marched first, the path's waits for it
                    aim = ray;
                    scattered = d;
                    d = ray.l;
                    goes = alive;
                    alive = lighting = true;
                }
#elif LIGHTS
                if (ray.weight != vec3(0.0)) {
                    int reached;
                    float distance = intersect_scene(o, ray.l, NO_HIT, reached);
                    radiance += light_reached(ray, o, reached, distance);
                }
#endif
            }
        }
#if HAS_ENVIRONMENT_MAP
#if LIGHTS && HAS_DISPLACED
        if (id < 0 && !lit)
#else
        if (id < 0)  // not in the branch above: reading an image there costs llvmpipe 5 % more, a constant 3 % less
#endif
#if HAS_SKY_LIGHT
            radiance += throughput * (environment(d) * OF_MET_LIGHT(environment_light_pdf(d)));
#else
            radiance += throughput * environment(d);
#endif
#endif
        if (!alive) {
            if (is_finite(radiance))
                sum += vec4(radiance, 1.0);
            vertex = 0;
            if (++finished == samples)
                break;
#if STARTS_AHEAD
            o = next_o;
            d = next_d;
            reach = next_reach;
            rng_state = next_state;
#endif
        }
    }
    return sum;
}

#endif
