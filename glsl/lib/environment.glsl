// Mitsuba's `envmap`: a latitude-longitude image as the light from infinity.
#ifndef LIB_ENVIRONMENT
#define LIB_ENVIRONMENT

#include "lib/uv.glsl"

// The texel of direction d, a unit vector of the map's own space (+y up): columns run around the y axis from -z
// towards +x and wrap, the first and the last of the `rows` lie on the poles. The sampler repeats in s, clamps to the
// edge in t and filters linearly. The inclination by an arc tangent, since an arc cosine loses half the digits near the
// poles.
//
// It belongs into the bounce loop, although there it is executed at every vertex: put off until a path is done, or two
// vertices, or a pass's samples, it cost 8 to 40 % more, since lanes then wait for each other or paths are remembered.
vec3 environment_texel(sampler2D image, float rows, vec3 d)
{
    float row = 2.0 * turns(length(d.xz), d.y) * (rows - 1.0);
    return textureLod(image, vec2(turns(d.x, -d.z), (row + 0.5) / rows), 0.0).rgb;
}

#endif
