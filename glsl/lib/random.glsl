// Random numbers: one independent PCG stream for each (pixel, sample, replica).
//
// PCG-RXS-M-XS-32: O'Neill 2014, "PCG: A Family of Simple Fast Space-Efficient Statistically Good Algorithms for
// Random Number Generation", HMC-CS-2014-0905, section 6.3; as an integer hash: Jarzynski & Olano 2020, "Hash
// Functions for GPU Rendering", JCGT 9(3), listing 5.
#ifndef LIB_RANDOM
#define LIB_RANDOM

uint rng_state;

// A bijective integer hash: one step of the generator, then its output permutation.
uint pcg_hash(uint v)
{
    uint state = v * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// The part of the seed that does not change from one sample of a pixel to the next: two independent 32-bit words.
uvec2 pixel_stream(uvec2 pixel, uint replica)
{
    uint a = pcg_hash(pixel.x + pcg_hash(pixel.y + pcg_hash(replica)));
    return uvec2(a, pcg_hash(a ^ 0x9e3779b9u));
}

// Bijective in `index`: a pixel never repeats a sample. The hash stands between the two keys, so that two pixels meet in
// no lag of their samples: where their hashes agree, their states still differ by the difference of the other key.
void seed_sample(uvec2 stream, uint index)
{
    rng_state = pcg_hash(index ^ stream.x) + stream.y;
}

// Uniform in [0, 1): the upper 24 bits, all that a float32 holds exactly.
float rand()
{
    uint state = rng_state;
    rng_state = state * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return float(((word >> 22u) ^ word) >> 8u) * (1.0 / 16777216.0);
}

// A point of the unit square: the next two numbers. What two numbers pick together is asked for together.
vec2 rand2()
{
    float first = rand();
    return vec2(first, rand());
}

#endif
