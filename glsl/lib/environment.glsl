// Mitsuba's `envmap`: a latitude-longitude image as the light from infinity.
#ifndef LIB_ENVIRONMENT
#define LIB_ENVIRONMENT

#include "lib/uv.glsl"

// The texel of direction d, a unit vector of the map's own space (+y up): columns run around the y axis from -z
// towards +x and wrap, the first and the last row lie on the poles. The sampler repeats in s, clamps to the edge in t
// and filters linearly. The inclination by an arc tangent, since an arc cosine loses half the digits near the poles.
vec3 environment_texel(sampler2D image, vec3 d)
{
    float rows = float(textureSize(image, 0).y);
    float row = 2.0 * turns(length(d.xz), d.y) * (rows - 1.0);
    return textureLod(image, vec2(turns(d.x, -d.z), (row + 0.5) / rows), 0.0).rgb;
}

#endif
