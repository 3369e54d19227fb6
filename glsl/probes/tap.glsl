// Taps: what the library's functions are given and what they return, at every vertex of one path of every pixel.
//
// The functions are interposed by macros before the files that call them are read, so this changes no line of what it
// observes, and fits any library that calls them by these names and signatures. What is observed is the shader of
// production, `main` included: `accumulated` has its bits. The file with `main` is included as tap/main.glsl.
//
// Records are vec4 in a storage buffer, so that none of them is carried through the loop: of each pixel first those of
// its path, then those of each vertex. Integers of 32 bits are two numbers, their upper and their lower half, which a
// float32 holds exactly.
#extension GL_ARB_shader_storage_buffer_object : require

layout(std430, binding = 0) buffer Taps { vec4 taps[]; };
uniform int tap_sample;      // of the pass, from 0
uniform int tap_vertices;    // for which there is room
uniform float tap_moment;    // in [0, 1): all paths then see that moment of the shutter's interval; as drawn if negative
uniform int tap_shape;       // of to_rest and from_rest, see TAP_POSE
uniform vec3 tap_point;

// Of a vertex.
#define TAP_ORIGIN 0       // of the ray, distance to the hit
#define TAP_RAY 1          // its direction, shape (-1 where it escapes)
#define TAP_NORMAL 2       // what surface_normal returned; which functions were called: sum of the TAP_CALLED_… below
#define TAP_PLACE 3        // what surface_normal was given; the ray's reach
#define TAP_FACING 4       // the normal that sample_phong was given; how far it, or the viewer's direction, is from those met
#define TAP_DIRECTION 5    // what sample_phong drew; numbers that it took
#define TAP_WEIGHT 6       // what it returned; numbers that the path took before
#define TAP_DIFFUSE 7      // kd, alpha
#define TAP_GLOSSY 8       // ks, p_glossy
#define TAP_LIGHT 9        // what emission or environment returned
#define TAP_SURFACE 10     // u, v; how far places and shapes handed on are from those met; the same of environment's direction
#define TAP_STATES 11      // the generator's before and after sample_phong
#define TAP_LOBE 12        // axis that a sampler of lib/sampling.glsl was given, exponent
#define TAP_NUMBERS 13     // its two numbers; pdf_lobe and pdf_cosine of the direction
#define TAP_BRDF 14        // eval_phong of the direction; its cosine to the mirror direction
#define TAP_TANGENT 15     // what to_world makes of local x about the axis; which sampler: 1 uniform, 2 cosine, 3 lobe
#define TAP_BITANGENT 16   // the same of local y
#define TAP_ABOUT 17       // direction_about of that axis, cosine 0.6 and the second number
#define TAP_TURNED 18      // what from_rest returned
#define TAP_LIFTED 19      // offset_origin of the place that was met and the normal that sample_phong was given; 1 if asked
#define TAP_MET 20         // the place that was met
#define TAP_VERTEX_RECORDS 21
// Of a path.
#define TAP_FILM 0         // film point, numbers of the lens
#define TAP_STREAM 1       // what pixel_stream returned
#define TAP_SEED 2         // index that seed_sample was given; the state after it
#define TAP_GENERATOR 3    // of all numbers of the pass: largest deviation from the published generator, wrong states, count, max
#define TAP_FIRST 4        // the path's first four numbers
#define TAP_TIME 5         // what set_time was given, path_time after it, how often it was called, 0
#define TAP_EYE 6          // the camera ray's origin and reach
#define TAP_GAZE 7         // its direction; vertices of the path
#define TAP_GIVEN 8        // the sum that trace_samples was given
#define TAP_RETURNED 9     // the sum that it returned
#define TAP_ASKED 10       // index of its first sample, replica, samples
#define TAP_PIXEL 11       // pixel and size that it was given
#define TAP_FINITE 12      // is_finite of a number that is not one, of infinity, of 1e30; 1 if asked
#define TAP_POSE 13        // to_rest(tap_shape, tap_point)
#define TAP_POSE_NORMAL 14 // from_rest(tap_shape, tap_point)
#define TAP_PATH_RECORDS 15

#define TAP_CALLED_INTERSECT 1.0
#define TAP_CALLED_NORMAL 2.0
#define TAP_CALLED_ENVIRONMENT 4.0
#define TAP_CALLED_EMISSION 8.0
#define TAP_CALLED_SCATTER 16.0

int tap_base;                // where the pixel's records begin
int tap_sample_now = -1, tap_vertex_now = -1;
int tap_drawn = 0;           // numbers of the path so far
vec4 tap_generator = vec4(0.0);
float tap_calls = 0.0;       // of functions at the vertex
float tap_times = 0.0;       // calls of set_time by the path
// How far what the loop hands on at the vertex is from what it was told: places, and the normal and viewer's direction.
float tap_astray, tap_askew;
// What the loop was last told, which it hands on to the next function.
vec3 tap_o, tap_d, tap_p, tap_rest, tap_n;
int tap_id;
vec2 tap_uv;
bool tap_shifts = false;     // from_rest is called next for the way to a projected hit, not for the normal

#include "lib/random.glsl"

vec2 tap_halves(uint word)
{
    return vec2(float(word >> 16u), float(word & 0xffffu));
}

bool tap_path()
{
    return tap_sample_now == tap_sample;
}

bool tap_here()
{
    return tap_path() && tap_vertex_now < tap_vertices;
}

#define tap_of_path(record) taps[tap_base + record]
#define tap_at_vertex(record) taps[tap_base + TAP_PATH_RECORDS + tap_vertex_now * TAP_VERTEX_RECORDS + record]

float tap_apart(vec3 a, vec3 b)
{
    vec3 c = abs(a - b);
    return max(max(c.x, c.y), c.z);
}

// Every number is compared with the published generator, written out again.
float tap_rand()
{
#if TAP_HAS_STATE
    uint state = rng_state;
    float found = rand();
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    float expected = float(((word >> 22u) ^ word) >> 8u) * (1.0 / 16777216.0);
    tap_generator.x = max(tap_generator.x, abs(found - expected));
    tap_generator.y += rng_state == state * 747796405u + 2891336453u ? 0.0 : 1.0;
#else
    float found = rand();
#endif
    tap_generator.z += 1.0;
    tap_generator.w = max(tap_generator.w, found);
    if (tap_path() && tap_drawn < 4)
        tap_of_path(TAP_FIRST)[tap_drawn] = found;
    ++tap_drawn;
    return found;
}

uvec2 tap_pixel_stream(uvec2 pixel, uint replica)
{
    uvec2 stream = pixel_stream(pixel, replica);
    tap_of_path(TAP_STREAM) = vec4(tap_halves(stream.x), tap_halves(stream.y));
    return stream;
}

// A path begins: the numbers of its film point are drawn next.
void tap_seed_sample(uvec2 stream, uint index)
{
    seed_sample(stream, index);
    ++tap_sample_now;
    tap_vertex_now = -1;
    tap_drawn = 0;
    if (tap_path()) {
#if TAP_HAS_STATE
        tap_of_path(TAP_SEED) = vec4(tap_halves(index), tap_halves(rng_state));
#else
        tap_of_path(TAP_SEED) = vec4(tap_halves(index), 0.0, 0.0);
#endif
        tap_times = 0.0;
    }
}

#define rand tap_rand
#define pixel_stream tap_pixel_stream
#define seed_sample tap_seed_sample

#include "lib/sampling.glsl"

void tap_lobe(float which, vec3 axis, float exponent, vec2 u)
{
    if (tap_here()) {
        tap_at_vertex(TAP_LOBE) = vec4(axis, exponent);
        tap_at_vertex(TAP_NUMBERS).xy = u;
#if TAP_HAS_BASIS
        tap_at_vertex(TAP_TANGENT) = vec4(to_world(vec3(1.0, 0.0, 0.0), axis), which);
        tap_at_vertex(TAP_BITANGENT).xyz = to_world(vec3(0.0, 1.0, 0.0), axis);
#else
        tap_at_vertex(TAP_TANGENT).w = which;
#endif
#if TAP_HAS_ABOUT
        tap_at_vertex(TAP_ABOUT).xyz = direction_about(axis, 0.6, u.y);
#endif
    }
}

#if TAP_HAS_SAMPLERS
vec3 tap_sample_uniform(vec3 n, vec2 u)
{
    tap_lobe(1.0, n, 0.0, u);
    return sample_uniform(n, u);
}

vec3 tap_sample_cosine(vec3 n, vec2 u)
{
    tap_lobe(2.0, n, 1.0, u);
    return sample_cosine(n, u);
}

vec3 tap_sample_lobe(vec3 axis, float alpha, vec2 u)
{
    tap_lobe(3.0, axis, alpha, u);
    return sample_lobe(axis, alpha, u);
}

#define sample_uniform tap_sample_uniform
#define sample_cosine tap_sample_cosine
#define sample_lobe tap_sample_lobe
#endif

#include "scene.glsl"
#include "lib/camera.glsl"
#include "lib/phong.glsl"

void tap_camera(vec2 film, vec2 u, vec3 o, vec3 d, float reach)
{
    if (tap_path()) {
        tap_of_path(TAP_FILM) = vec4(film, u);
        tap_of_path(TAP_EYE) = vec4(o, reach);
        tap_of_path(TAP_GAZE).xyz = d;
    }
}

#if HAS_LENS
void tap_lens_ray(vec2 film, vec2 u, out vec3 o, out vec3 d, out float reach)
{
    lens_ray(film, u, o, d, reach);
    tap_camera(film, u, o, d, reach);
}
#define lens_ray tap_lens_ray
#else
void tap_camera_ray(vec2 film, out vec3 o, out vec3 d, out float reach)
{
    camera_ray(film, o, d, reach);
    tap_camera(film, vec2(0.0), o, d, reach);
}
#define camera_ray tap_camera_ray
#endif

void tap_begin_vertex(float reach)
{
    ++tap_vertex_now;
    tap_calls = TAP_CALLED_INTERSECT;
    tap_astray = tap_askew = 0.0;
    tap_shifts = false;
    if (tap_path())
        tap_of_path(TAP_GAZE).w = float(tap_vertex_now + 1);
    if (tap_here())
        tap_at_vertex(TAP_PLACE).w = reach;
}

void tap_hit(vec3 o, vec3 d, float t, int id)
{
    tap_o = o;
    tap_d = d;
    tap_p = o + t * d;
    tap_rest = tap_p;
    tap_id = id;
    if (tap_here()) {
        tap_at_vertex(TAP_ORIGIN) = vec4(o, t);
        tap_at_vertex(TAP_RAY) = vec4(d, float(id));
        tap_at_vertex(TAP_MET).xyz = tap_p;
        tap_at_vertex(TAP_NORMAL).w = tap_calls;
    }
}

void tap_call(float which)
{
    tap_calls += which;
    if (tap_here())
        tap_at_vertex(TAP_NORMAL).w = tap_calls;
}

// A place handed on must be the one that was met, on the shape that was.
void tap_place(int id, vec3 p)
{
    tap_astray = max(tap_astray, id == tap_id ? tap_apart(p, tap_rest) : 1e30);
    if (tap_here())
        tap_at_vertex(TAP_SURFACE).z = tap_astray;
}

#if HAS_DISPLACED
float tap_intersect_shapes(vec3 o, vec3 d, float reach, out int id)
{
    tap_begin_vertex(reach);
    return intersect_shapes(o, d, reach, id);
}
#define intersect_shapes tap_intersect_shapes

bool tap_march_on(vec3 o, vec3 d)
{
    bool more = march_on(o, d);
    if (!more)
        tap_hit(o, d, march.t, march.id);
    return more;
}
#define march_on tap_march_on
#else
float tap_intersect_scene(vec3 o, vec3 d, float reach, out int id)
{
    tap_begin_vertex(reach);
    float t = intersect_scene(o, d, reach, id);
    tap_hit(o, d, t, id);
    return t;
}
#define intersect_scene tap_intersect_scene
#endif

#if HAS_MOTION
void tap_set_time(float u)
{
    set_time(u);
    if (tap_path())
        tap_of_path(TAP_TIME) = vec4(u, path_time, ++tap_times, 0.0);
    if (tap_moment >= 0.0)
        set_time(tap_moment);
}
#define set_time tap_set_time

vec3 tap_to_rest(int id, vec3 p)
{
    tap_place(id, p);
    tap_rest = to_rest(id, p);
    return tap_rest;
}
#define to_rest tap_to_rest

vec3 tap_from_rest(int id, vec3 n)
{
    if (tap_shifts) {
        vec3 shift = from_rest(id, n);
        tap_shifts = false;
        tap_p += shift;
        if (tap_here())
            tap_at_vertex(TAP_MET).xyz = tap_p;
        return shift;
    }
    tap_askew = max(tap_askew, tap_apart(n, tap_n));
    tap_n = from_rest(id, n);
    if (tap_here())
        tap_at_vertex(TAP_TURNED).xyz = tap_n;
    return tap_n;
}
#define from_rest tap_from_rest
#endif

vec3 tap_surface_normal(int id, vec3 p)
{
    tap_place(id, p);
    tap_call(TAP_CALLED_NORMAL);
    tap_n = surface_normal(id, p);
    if (tap_here()) {
        tap_at_vertex(TAP_NORMAL).xyz = tap_n;
        tap_at_vertex(TAP_PLACE).xyz = p;
        tap_at_vertex(TAP_TURNED).xyz = tap_n;
    }
    return tap_n;
}
#define surface_normal tap_surface_normal

#ifdef HAS_PROJECTION
#if HAS_PROJECTION
vec3 tap_project_hit(int id, vec3 p, vec3 n)
{
    tap_place(id, p);
    tap_askew = max(tap_askew, tap_apart(n, tap_n));
    tap_rest = project_hit(id, p, n);
#if HAS_MOTION
    tap_shifts = true;
#else
    tap_p = tap_rest;
    if (tap_here())
        tap_at_vertex(TAP_MET).xyz = tap_p;
#endif
    return tap_rest;
}
#define project_hit tap_project_hit
#endif
#endif

vec2 tap_surface_uv(int id, vec3 p)
{
    tap_place(id, p);
    tap_uv = surface_uv(id, p);
    if (tap_here())
        tap_at_vertex(TAP_SURFACE).xy = tap_uv;
    return tap_uv;
}
#define surface_uv tap_surface_uv

#if HAS_PROCEDURAL
void tap_evaluate_procedural(int id, vec3 p)
{
    tap_place(id, p);
    evaluate_procedural(id, p);
}
#define evaluate_procedural tap_evaluate_procedural
#endif

Material tap_material(int id, vec3 p, vec2 uv)
{
    tap_place(id, p + vec3(uv - tap_uv, 0.0));
    return material(id, p, uv);
}
#define material tap_material

#if HAS_EMISSION
vec3 tap_emission(int id, vec3 p, vec2 uv)
{
    tap_place(id, p + vec3(uv - tap_uv, 0.0));
    tap_call(TAP_CALLED_EMISSION);
    vec3 value = emission(id, p, uv);
    if (tap_here())
        tap_at_vertex(TAP_LIGHT).xyz = value;
    return value;
}
#define emission tap_emission
#endif

vec3 tap_environment(vec3 d)
{
    tap_call(TAP_CALLED_ENVIRONMENT);
    vec3 value = environment(d);
    if (tap_here()) {
        tap_at_vertex(TAP_LIGHT).xyz = value;
        tap_at_vertex(TAP_SURFACE).w = tap_apart(d, tap_d);
    }
    return value;
}
#define environment tap_environment

#if TAP_HAS_OFFSET
vec3 offset_origin(vec3 p, vec3 n);
#endif

vec3 tap_sample_phong(Material m, vec3 n, vec3 v, out vec3 l)
{
    tap_call(TAP_CALLED_SCATTER);
    tap_askew = max(tap_askew, max(tap_apart(v, -tap_d), min(tap_apart(n, tap_n), tap_apart(n, -tap_n))));
    int before = tap_drawn;
    if (tap_here()) {
        tap_at_vertex(TAP_FACING) = vec4(n, tap_askew);
        tap_at_vertex(TAP_DIFFUSE) = vec4(m.kd, m.alpha);
        tap_at_vertex(TAP_GLOSSY) = vec4(m.ks, m.p_glossy);
#if TAP_HAS_STATE
        tap_at_vertex(TAP_STATES).xy = tap_halves(rng_state);
#endif
    }
    vec3 weight = sample_phong(m, n, v, l);
    if (tap_here()) {
        tap_at_vertex(TAP_DIRECTION) = vec4(l, float(tap_drawn - before));
        tap_at_vertex(TAP_WEIGHT) = vec4(weight, float(before));
#if TAP_HAS_STATE
        tap_at_vertex(TAP_STATES).zw = tap_halves(rng_state);
#endif
        float cos_to_mirror = dot(2.0 * dot(n, v) * n - v, l);
#if TAP_HAS_PDFS
        tap_at_vertex(TAP_NUMBERS).zw = vec2(pdf_lobe(cos_to_mirror, m.alpha), pdf_cosine(dot(n, l)));
#endif
#if TAP_HAS_EVAL
        tap_at_vertex(TAP_BRDF) = vec4(eval_phong(m, cos_to_mirror), cos_to_mirror);
#endif
#if TAP_HAS_OFFSET
        tap_at_vertex(TAP_LIFTED) = vec4(offset_origin(tap_p, n), 1.0);
#endif
    }
    return weight;
}
#define sample_phong tap_sample_phong

#include "lib/path.glsl"

vec4 tap_trace_samples(vec4 sum, uvec2 pixel, vec2 size, uint replica, uint first, int samples)
{
    tap_of_path(TAP_GIVEN) = sum;
    tap_of_path(TAP_ASKED) = vec4(tap_halves(first), float(replica), float(samples));
    tap_of_path(TAP_PIXEL) = vec4(vec2(pixel), size);
    vec4 returned = trace_samples(sum, pixel, size, replica, first, samples);
    tap_of_path(TAP_RETURNED) = returned;
    return returned;
}
#define trace_samples tap_trace_samples

#define main tap_production_main
#include "tap/main.glsl"
#undef main

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    tap_base = (pixel.y * textureSize(pingpong0, 0).x + pixel.x) * (TAP_PATH_RECORDS + tap_vertices * TAP_VERTEX_RECORDS);
    tap_production_main();
    tap_of_path(TAP_GENERATOR) = tap_generator;
#if HAS_MOTION
#undef to_rest
#undef from_rest
    tap_of_path(TAP_POSE).xyz = to_rest(tap_shape, tap_point);
    tap_of_path(TAP_POSE_NORMAL).xyz = from_rest(tap_shape, tap_point);
#endif
#if TAP_HAS_FINITE
    tap_of_path(TAP_FINITE) = vec4(is_finite(vec3(0.0, uintBitsToFloat(0x7fc00000u), 0.0)),
                                   is_finite(vec3(uintBitsToFloat(0x7f800000u))), is_finite(vec3(1e30)), 1.0);
#endif
}
