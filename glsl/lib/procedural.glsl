// The textures marble and wood and the ramps that colour them: the formulas of harness/scene/procedural.py. The scene's
// generated code puts them together with the noise of its octaves.
#ifndef LIB_PROCEDURAL
#define LIB_PROCEDURAL

#include "lib/noise.glsl"

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

// How far t has gone between the stops `index` and `index` + 1 of a ramp whose last stop is `last`, within [0, 1].
float ramp_step(float t, float last, float index)
{
    return clamp(t * last - index, 0.0, 1.0);
}

#endif
