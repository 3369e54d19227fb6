// Mitsuba's `envmap`: a latitude-longitude image as the light from infinity, and directions drawn from it.
#ifndef LIB_ENVIRONMENT
#define LIB_ENVIRONMENT

#include "lib/sampling.glsl"
#include "lib/trigonometry.glsl"
#include "lib/uv.glsl"

// The texel of direction d, a unit vector of the map's own space (+y up): columns run around the y axis from -z
// towards +x and wrap, the first and the last of the `rows` lie on the poles. The sampler repeats in s, clamps to the
// edge in t and filters linearly. The inclination by an arc tangent, since an arc cosine loses half the digits near the
// poles. rgb is the radiance; where directions are drawn, alpha is their pdf, for which nothing else is read.
//
// It belongs into the bounce loop, although there it is executed at every vertex: put off until a path is done, or two
// vertices, or a pass's samples, it cost 8 to 40 % more, since lanes then wait for each other or paths are remembered.
vec4 environment_texel(sampler2D image, float rows, vec3 d)
{
    float row = 2.0 * turns(length(d.xz), d.y) * (rows - 1.0);
    return textureLod(image, vec2(turns(d.x, -d.z), (row + 0.5) / rows), 0.0);
}

// Directions with the density of a bilinear image are drawn in two steps: a texel, and a direction under its tent, which
// falls from 1 at the texel's centre to 0 at its neighbours', linearly in both angles (harness/scene/importance.py).
//
// Sine of half the angle of a cap about the pole: caps are what the tent of a texel on the pole is made of, one on the
// other, each even per steradian, and 1 - cos of their angle is how often each is drawn. `part` is uniform, `cap` the
// angle of the widest, `half_sine` the sine of its half. From z - sin z = part (cap - sin cap), to 2e-6.
float sample_cap(float part, float cap, float half_sine)
{
    float c = pow(part, 1.0 / 3.0);
    float y = c * c;
    float x = cap * cap;
    float bent = x * (0.02500142 + x * (0.000636777 + 0.000844828 * y
        + x * (1.893667e-5 + y * (9.31922e-6 + y * 4.92828e-5))));
    return half_sine * c * (1.0 + (1.0 - y) * bent);
}

// The polar angle of a direction under the tent of row `row`, counted from the nearer pole, as the squared sine of its
// half; solid angle is even in it. A tent is a pile of zones about θ = row Δ, from θ - h to θ + h for h up to Δ: a zone
// is drawn by its solid angle, which is sin θ sin h, then a place in it. No difference of nearly equal numbers is taken,
// so the rows next to the poles are as exact as any. `zone` and `place` are uniform.
float sample_tent(float row, float rows, float zone, float place)
{
    float angle = PI / (rows - 1.0);
    float half_sine = cos_sin(0.5 * angle).y;
    vec2 middle = cos_sin(0.5 * angle * row);
    bool on_pole = row < 0.5;
    float k = on_pole ? sample_cap(zone, angle, half_sine) : half_sine * sqrt(zone);  // sin(h/2)
    float c = sqrt(1.0 - k * k);
    float nearest = middle.y * c - middle.x * k;
    return on_pole ? place * k * k : nearest * nearest + place * 4.0 * middle.x * middle.y * k * c;
}

// A direction of the map's space, of density proportional to the alpha of environment_texel. `table`: the alias table of
// an image of size.x columns and size.y rows, filter nearest. pick and u.x choose the bin, and with what is left of
// them: pick between the bin's two texels, u.x the azimuth. u.y falls into two numbers of 12 bits, taken at their
// middles.
vec3 sample_environment_texel(sampler2D table, vec2 size, float pick, vec2 u)
{
    vec2 at = vec2(u.x, pick) * size;
    vec2 texel = min(floor(at), size - 1.0);
    vec2 rest = at - texel;
    vec4 bin = textureLod(table, (texel + 0.5) / size, 0.0);
    texel = rest.y < bin.x ? texel : bin.yz;

    float side = 2.0 * rest.x - 1.0;
    float away = 1.0 - sqrt(1.0 - abs(side));  // has the density 1 - away
    float phi = 2.0 * PI * ((texel.x + 0.5 + (side < 0.0 ? -away : away)) / size.x);

    float zone = floor(u.y * 4096.0);
    float place = u.y * 4096.0 - zone + 0.5 / 4096.0;
    float from_pole = min(texel.y, size.y - 1.0 - texel.y);
    float drop = sample_tent(from_pole, size.y, (zone + 0.5) / 4096.0, place);
    float height = 1.0 - 2.0 * drop;
    float radius = 2.0 * sqrt(drop * (1.0 - drop));
    return vec3(sin(phi) * radius, texel.y == from_pole ? height : -height, -cos(phi) * radius);
}

#endif
