// The textures fractal, marble and wood, and the ramps that colour them: the formulas of harness/scene/procedural.py.
//
// A texture is a function of a place q in its own space, counted in cells of noise. Each function of that name takes q
// and the fractal sum of value noise at q * NAME_GRAIN (w its value, xyz its gradient along its own argument), and
// returns w the texture's place t on its colour ramp, within [0, 1], and xyz the gradient of t along q, which only a
// displaced surface needs. The sum is written out by the scene's generated code, octave by octave (see fbm).
//
// To add a texture: its function here, with its constants where it has some, and its row in KINDS of that Python file.
#ifndef LIB_PROCEDURAL
#define LIB_PROCEDURAL

#include "lib/noise.glsl"

// Part of the period in which a wave climbs: early wood grows slowly darker, late wood ends in a sharp edge.
const float MARBLE_RISE = 0.5;
const float WOOD_RISE = 0.75;
// The noise that bends wood's rings is wider than they are, and stretched along the trunk.
const vec3 WOOD_GRAIN = vec3(0.25, 0.25, 0.0625);

// A point under an affine transform, of which the rows are given. In the order of `transformed` of the Python file, so
// that both renderers round alike, which a steep texture would show: dot() may add up in another.
vec3 to_cells(vec4 row_x, vec4 row_y, vec4 row_z, vec3 p)
{
    precise vec3 q = vec3(row_x.x * p.x + row_x.y * p.y + row_x.z * p.z + row_x.w,
                          row_y.x * p.x + row_y.y * p.y + row_y.z * p.z + row_y.w,
                          row_z.x * p.x + row_z.y * p.y + row_z.z * p.z + row_z.w);
    return q;
}

// A wave of period 1 that climbs from 0 to 1 over the part `rise` of the period and falls back over the rest, along
// 3x² - 2x³ both ways: x its value, y its derivative.
vec2 wave(float s, float rise)
{
    float f = s - floor(s);
    bool climbing = f < rise;
    float x = climbing ? f * (1.0 / rise) : (1.0 - f) * (1.0 / (1.0 - rise));
    float slope = climbing ? 1.0 / rise : -1.0 / (1.0 - rise);
    return vec2(x * x * (3.0 - 2.0 * x), slope * 6.0 * x * (1.0 - x));
}

// Nothing but the noise, which `distortion` has no part in.
vec4 fractal(vec3 q, vec4 noise, float distortion)
{
    return noise;
}

// Veins across the x axis, bent by the noise.
vec4 marble(vec3 q, vec4 noise, float distortion)
{
    vec2 vein = wave(q.x + distortion * noise.w, MARBLE_RISE);
    return vec4(vein.y * (vec3(1.0, 0.0, 0.0) + distortion * noise.xyz), vein.x);
}

// How far q lies from the axis of wood's rings, the z axis.
float wood_radius(vec3 q)
{
    return length(q.xy);
}

// Rings about the z axis, bent by the noise.
vec4 wood(vec3 q, vec4 noise, float distortion)
{
    float radius = wood_radius(q);
    vec3 outwards = vec3(q.xy / max(radius, 1e-30), 0.0);
    vec2 ring = wave(radius + distortion * noise.w, WOOD_RISE);
    return vec4(ring.y * (outwards + distortion * WOOD_GRAIN * noise.xyz), ring.x);
}

// How far t has gone between the stops `index` and `index` + 1 of a ramp whose last stop is `last`, within [0, 1].
float ramp_step(float t, float last, float index)
{
    return clamp(t * last - index, 0.0, 1.0);
}

// How far t is from the nearest stop between the ends of that ramp, where its slope changes; `last` is at least 2.
float ramp_room(float t, float last)
{
    return abs(t - clamp(round(t * last), 1.0, last - 1.0) / last);
}

#endif
