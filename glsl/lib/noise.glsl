// Value noise: random values on the integer lattice, interpolated by a quintic that is twice differentiable.
//
// Perlin 2002, "Improving Noise", SIGGRAPH, for the quintic; Ebert et al. 2003, "Texturing and Modeling", 3rd ed.,
// chapter 2, for value noise and its sums. The lattice is hashed with integers, so that every renderer has the same
// values: harness/scene/noise.py holds the same formulas for Mitsuba. (The handout's fract(sin(n) * 43758.5453123)
// differs between renderers by up to the whole range.)
#ifndef LIB_NOISE
#define LIB_NOISE

// Of the hash's linear part: three primes of xxHash32 for the axes, for which cells that share a hash are 1652 cells
// apart or more (at best, 2^(32/3) 2^(1/6) = 1826), and the step of PCG (see random.glsl) for the seed.
const uint NOISE_X = 0x85ebca77u;
const uint NOISE_Y = 0xc2b2ae3du;
const uint NOISE_Z = 0x165667b1u;
const uint NOISE_SEED = 747796405u;
const uint NOISE_OFFSET = 2891336453u;
const uint NOISE_OCTAVE = 0x9e3779b9u;  // from the seed of one octave to that of the next: the golden ratio's bits
const float NOISE_UNIT = 1.0 / 16777216.0;  // 2^-24: the step of lattice values, which are scaled last

// PCG's output permutation over four states: the upper 24 bits, as whole numbers up to 2^24. Its last xorshift is left
// out, which changes none of the upper 22.
vec4 lattice_values(uvec4 state)
{
    uvec4 word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return vec4(word >> 8u);
}

// Whole numbers within ±2^22 as integers, modulo 2^32: beside 1.5 * 2^23, whose float32 spacing is 1, they are the last
// bits. A conversion saturates on Mesa 25, and is made lane by lane: noise took 1.2 to 1.4 times as long.
uvec3 whole(vec3 x)
{
    return floatBitsToUint(x + 12582912.0) - 0x4b400000u;
}

// Values at the corners of the cell of `corner` in steps of 2^-24: lower z, then upper; x runs first, then y.
void cell_values(vec3 corner, uint seed, out vec4 lower, out vec4 upper)
{
    uvec3 cell = whole(corner);
    uint first = cell.x * NOISE_X + cell.y * NOISE_Y + cell.z * NOISE_Z + (seed * NOISE_SEED + NOISE_OFFSET);
    uvec4 state = first + uvec4(0u, NOISE_X, NOISE_Y, NOISE_X + NOISE_Y);
    lower = lattice_values(state);
    upper = lattice_values(state + NOISE_Z);
}

// Value noise at p, within [0, 1]; a cell is a unit cube.
float value_noise(vec3 p, uint seed)
{
    vec3 corner = floor(p);
    vec3 f = p - corner;
    vec3 s = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    vec4 lower, upper;
    cell_values(corner, seed, lower, upper);
    vec4 a = lower + s.z * (upper - lower);
    vec2 b = a.xy + s.y * (a.zw - a.xy);
    return (b.x + s.x * (b.y - b.x)) * NOISE_UNIT;
}

// xyz the gradient of the noise at p, w the noise, all in units of NOISE_UNIT.
vec4 cell_noise_gradient(vec3 p, uint seed)
{
    vec3 corner = floor(p);
    vec3 f = p - corner;
    vec3 s = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    vec3 slope = 30.0 * f * f * (f * (f - 2.0) + 1.0);
    vec4 lower, upper;
    cell_values(corner, seed, lower, upper);
    vec4 along_z = upper - lower;
    vec4 a = lower + s.z * along_z;
    vec2 along_y = a.zw - a.xy;
    vec2 b = a.xy + s.y * along_y;
    vec2 z = along_z.xy + s.y * (along_z.zw - along_z.xy);
    vec3 along = vec3(b.y - b.x, along_y.x + s.x * (along_y.y - along_y.x), z.x + s.x * (z.y - z.x));
    return vec4(slope * along, b.x + s.x * along.x);
}

// Fractal noise, Σ gain^i noise(lacunarity^i p) / Σ gain^i over i < octaves, each octave with a seed of its own; within
// [0, 1]. The definition; scenes have their octaves written out, since of more than about 5 Mesa keeps the loop, and its
// iterations count among the 65,535 that llvmpipe of Mesa 22 allows (see harness/gpu/device.py).
float fbm(vec3 p, int octaves, float lacunarity, float gain, uint seed)
{
    float sum = 0.0, weights = 0.0, weight = 1.0;
    for (int i = 0; i < octaves; ++i) {
        sum += weight * value_noise(p, seed);
        weights += weight;
        weight *= gain;
        p *= lacunarity;
        seed += NOISE_OCTAVE;
    }
    return sum / weights;
}

#endif
