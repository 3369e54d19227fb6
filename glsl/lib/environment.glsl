// Mitsuba's `envmap`: a latitude-longitude image as the light from infinity, and directions drawn from it.
#ifndef LIB_ENVIRONMENT
#define LIB_ENVIRONMENT

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
// falls from 1 at the texel's centre to 0 at its neighbours', linearly in both angles (harness/scene/importance.py, which
// makes the table by which texels are drawn as well).

// How many bins the table's bands and blocks are looked up by.
const float ENVIRONMENT_BINS = 512.0;

// Sine of half the angle of a cap about the pole: caps are what the tent of a texel on the pole is made of, one on the
// other, each even per steradian, and z - sin z, z the angle, grows evenly. `part` is uniform, `widest` the angle of the
// widest cap, `half_sine` the sine of its half. To 2e-6.
float sample_cap(float part, float widest, float half_sine)
{
    float c = pow(part, 1.0 / 3.0);
    float y = c * c;
    float x = widest * widest;
    float bent = x * (0.02500142 + x * (0.000636777 + 0.000844828 * y
        + x * (1.893667e-5 + y * (9.31922e-6 + y * 4.92828e-5))));
    return half_sine * c * (1.0 + (1.0 - y) * bent);
}

// The polar angle of a direction under the tent of row `row`, counted from the nearer pole, as the squared sine of its
// half, in which solid angle is even. A tent is a pile of zones about θ = row Δ, from θ - h to θ + h for all h up to Δ: a
// zone is drawn by its solid angle, which is proportional to sin θ sin h, then a place in it; both numbers are uniform.
// No difference of nearly equal numbers is taken, so the rows next to the poles are as exact as any.
float sample_tent(float row, float rows, float zone, float place)
{
    float angle = 3.14159265358979 / (rows - 1.0);
    float half_sine = cos_sin(0.5 * angle).y;
    vec2 middle = cos_sin(0.5 * angle * row);
    bool on_pole = row < 0.5;
    float k = on_pole ? sample_cap(zone, angle, half_sine) : half_sine * sqrt(zone);  // sin(h/2)
    float c = sqrt(1.0 - k * k);
    float nearest = middle.y * c - middle.x * k;
    return on_pole ? place * k * k : nearest * nearest + place * 4.0 * middle.x * middle.y * k * c;
}

// Which of the `runs` of rows or columns a number in [0, 1) means, x = (its first bin, how many it has, its first row or
// column, how many it has), and where: the index of a row or column, and a number that is uniform within it.
vec2 place_in_run(float u, vec4 run)
{
    float at = (u * ENVIRONMENT_BINS - run.x) / run.y * run.w;
    float index = min(floor(at), run.w - 1.0);
    return vec2(run.z + index, at - index);
}

// A direction of the map's space, of density proportional to the alpha of environment_texel, an image of size.x columns
// and size.y rows. `table`, filter nearest, has size.z columns and size.w rows. u.y chooses a band of rows and a row in
// it, u.x a block of columns and a column, pick that texel or its alias; what is left of each moves the direction under
// the tent of the texel. So points of the square that are spread evenly give directions that are. At the very end of a tent the pdf
// may be rounded to 0, where the radiance is 0 too: such a direction brings nothing.
vec3 sample_environment_texel(sampler2D table, vec4 size, float pick, vec2 u)
{
    vec4 band = textureLod(table, (vec2(floor(u.y * ENVIRONMENT_BINS), size.y) + 0.5) / size.zw, 0.0);
    float number = floor(band.x / ENVIRONMENT_BINS);
    band.x -= ENVIRONMENT_BINS * number;
    vec2 bin_in_band = vec2(floor(u.x * ENVIRONMENT_BINS), size.y + 1.0 + number);
    vec2 row = place_in_run(u.y, band);
    vec2 column = place_in_run(u.x, textureLod(table, (bin_in_band + 0.5) / size.zw, 0.0));
    vec4 bin = textureLod(table, (vec2(column.x, row.x) + 0.5) / size.zw, 0.0);
    bool own = pick < bin.x;
    vec2 texel = own ? vec2(column.x, row.x) : bin.yz;
    float place = own ? pick / bin.x : (pick - bin.x) / (1.0 - bin.x);

    float side = 2.0 * column.y - 1.0;
    float away = 1.0 - sqrt(1.0 - abs(side));  // has the density 1 - away
    float phi = 6.28318530717959 * ((texel.x + 0.5 + (side < 0.0 ? -away : away)) / size.x);
    float from_pole = min(texel.y, size.y - 1.0 - texel.y);
    float drop = sample_tent(from_pole, size.y, row.y, place);
    float height = 1.0 - 2.0 * drop;
    float radius = 2.0 * sqrt(drop * (1.0 - drop));
    return vec3(sin(phi) * radius, texel.y == from_pole ? height : -height, -cos(phi) * radius);
}

#endif
