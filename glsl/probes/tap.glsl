// Taps: what the library's functions are given and what they return, at every vertex of one path of every pixel.
//
// The functions are interposed by macros before the files that call them are read, so this changes no line of what it
// observes, and fits any library that calls them by these names and signatures. What is observed is the shader of
// production, `main` included, in the plain form of its loop (see lib/path.glsl): `accumulated` has its bits. The file
// with `main` is included as tap/main.glsl.
//
// Records are vec4 in a storage buffer, so that none of them is carried through the loop: of each pixel first those of
// its path, then those of each vertex. Integers of 32 bits are two numbers, their upper and their lower half, which a
// float32 holds exactly. The taps of each topic are a file of probes/tap/.
#extension GL_ARB_shader_storage_buffer_object : require

#include "probes/tap/records.glsl"
#include "lib/random.glsl"
#include "probes/tap/numbers.glsl"
#include "lib/sampling.glsl"
#include "probes/tap/directions.glsl"
#include "scene.glsl"
#include "lib/camera.glsl"
#include "lib/phong.glsl"
#include "probes/tap/camera.glsl"
#include "probes/tap/meeting.glsl"
#include "probes/tap/looks.glsl"
#include "probes/tap/scattering.glsl"
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
