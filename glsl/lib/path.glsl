// The estimator: L = 1/N Σ f(l,v) Li(l) (n·l) / pdf(l), unrolled along a path. Emission is gathered where a path
// meets it, the environment where a path escapes; light sources are never sampled.
#ifndef LIB_PATH
#define LIB_PATH

#include "lib/random.glsl"
#include "lib/camera.glsl"
#include "lib/phong.glsl"

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
#define PATH_ITERATIONS (MAX_DEPTH * (1 + MAX_MARCH_STEPS))
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
    int vertex = 0;      // of the current path; 0 means that a new one is due
    int finished = 0;
#if HAS_DISPLACED
    bool marching = false;  // the current ray's march is not at its end
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
        if (id < 0) {
#if !HAS_ENVIRONMENT_MAP
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
            float facing = -dot(n, d);
#if HAS_EMISSION
            if (facing > 0.0)
                radiance += throughput * emission(id, rest, uv);
#endif
#if HAS_TWO_SIDED
            if (facing < 0.0 && is_two_sided(id)) {
                n = -n;
                facing = -facing;
            }
#endif
            if (facing > 0.0 && vertex < MAX_DEPTH) {
                vec3 l;
                throughput *= sample_phong(material(id, rest, uv), n, -d, l);
                o = offset_origin(p, n);
                d = l;
                reach = NO_HIT;
                alive = goes_on(id, n, l, throughput);
            }
        }
#if HAS_ENVIRONMENT_MAP
        if (id < 0)  // not in the branch above: reading an image there costs llvmpipe 5 % more, a constant 3 % less
            radiance += throughput * environment(d);
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
