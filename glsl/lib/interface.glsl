// What a scene must define, for lib/path.glsl to trace it. Our scenes are generated (harness/shader/scene/chunk.py); one
// written by hand needs the same, before this file is read.
//
// Conventions: right-handed world space, in the scene's own units; angles in radians; directions are unit vectors and point
// away from the surface; radiance is linear Rec. 709 RGB. Shapes are numbered from 0; -1 is no shape. `rest` is a point of
// a shape where it rests, which is where it is met unless it moves; `uv` what surface_uv says of that point.
//
// To add a shape: its hit, normal and uv in lib/shapes.glsl and lib/uv.glsl, and where it shines a draw and its density in
// lib/lights.glsl. A texture: lib/procedural.glsl. A way to draw directions: lib/phong.glsl, a sample and its density.
#ifndef LIB_INTERFACE
#define LIB_INTERFACE

// Switches, 0 or 1: MAX_DEPTH (vertices of a path at most), HAS_DIFFUSE, HAS_GLOSSY (any material has the term), HAS_EMISSION
// (any shape shines), HAS_TWO_SIDED, HAS_PROCEDURAL, HAS_LENS, HAS_MOTION, HAS_DISPLACED, HAS_PROJECTION (rays are so long
// that hits are moved back onto their shapes), HAS_ENVIRONMENT_MAP. STRATEGY is one of lib/phong.glsl's, LIGHTS one of the
// three here, with HAS_LIGHT_CHOICE (there is more than one), HAS_SHAPE_LIGHTS, HAS_SKY_LIGHT and HEURISTIC (lib/mis.glsl).
// The camera's constants stand in lib/camera.glsl. BITMAPS_AHEAD is 1 where a device reads a point's bitmaps before all else.

// How light is found: met by paths alone, sampled alone (next-event estimation), or both (multiple importance sampling).
#define LIGHTS_MET 0
#define LIGHTS_NEE 1
#define LIGHTS_MIS 2
#ifndef LIGHTS
#define LIGHTS LIGHTS_MET
#endif
#if LIGHTS == LIGHTS_MET
#define HAS_SHAPE_LIGHTS 0
#define HAS_SKY_LIGHT 0
#endif

#if !defined(BITMAPS_AHEAD)
#define BITMAPS_AHEAD 0
#endif

// The distance to the nearest hit along o + t d within `reach`, and the shape; `reach` and -1 where there is none. Where
// spheres are displaced, lib/displaced.glsl has this function, and the scene intersect_shapes, of the other shapes.
float intersect_scene(vec3 o, vec3 d, float reach, out int id);
vec3 surface_normal(int id, vec3 rest);                // outward, unit length
vec2 surface_uv(int id, vec3 rest);
Material material(int id, vec3 rest, vec2 uv);
vec3 environment(vec3 d);                              // the radiance that arrives from direction d
#if HAS_EMISSION
vec3 emission(int id, vec3 rest, vec2 uv);             // the radiance that leaves the front
#endif
#if HAS_TWO_SIDED
bool is_two_sided(int id);                             // whether the back is shaded like the front
#endif
#if HAS_GLOSSY
bool is_black(int id);                                 // whether nothing is reflected anywhere
#endif
#if HAS_PROCEDURAL
void evaluate_procedural(int id, vec3 rest);           // before material, emission and light_radiance of that point
#endif
#if BITMAPS_AHEAD
void look_up_bitmaps(int id, vec2 uv);                 // before material and emission of that point
#endif
#if HAS_PROJECTION
vec3 project_hit(int id, vec3 rest, vec3 n);           // the nearest point of the shape
#endif
#if HAS_MOTION
void set_time(float u);                                // of the path, as a part of the shutter's interval
vec3 to_rest(int id, vec3 p);                          // a point, from where it is at that time to where it rests
vec3 from_rest(int id, vec3 n);                        // a direction, back
#endif
#if LIGHTS
int choose_light(float u, out float chance);           // a shape that shines, or -1 for the environment, and its probability
LightSample sample_light(int id, vec3 o, vec3 n, float pick, vec2 u);  // a direction towards it, from o with normal n
#endif
#if HAS_SHAPE_LIGHTS
vec3 light_radiance(int id, vec3 p, vec3 d);           // what it sends back along the ray d that met it at p
#endif
#if LIGHTS == LIGHTS_MIS && HAS_SHAPE_LIGHTS
float met_light_pdf(int id, vec3 o, float t, float facing);  // the density per steradian of a direction that met it
#endif
#if LIGHTS == LIGHTS_MIS && HAS_SKY_LIGHT
float environment_light_pdf(vec3 d);                   // and of one that escaped
#endif

#endif
