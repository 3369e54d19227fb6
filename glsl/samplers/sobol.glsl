// The sampler `sobol`: numbers in place of those of lib/random.glsl, spread evenly over the samples of a pixel.
//
// Each call of rand() or rand2() is a dimension, or a pair of them, of its own: the first two of Sobol's sequence, which
// are a (0,2)-sequence, with their index shuffled and their digits scrambled by hashes. So the first 2^k samples of a
// pixel, and each next 2^k, put exactly one number into each of 2^k equal cells; and calls know nothing of one another.
// Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4): scrambling (section 3), padding (section 4.2).
//
// The scramble hangs on pixel and replica alone. Over replicas each number is uniform and independent of all others, so
// means are unbiased; within one replica samples are not independent of each other, which is what they are for.
uint sobol_index;  // of the sample, its lowest bit last; rng_state seeds the scrambles of a path's calls, one by one

// A random permutation of 32-bit numbers in which a digit hangs on itself and those below it alone: nested scrambling of
// a number whose first digit is its lowest bit (Owen 1995). Laine & Karras 2011, "Stratified Sampling for Stochastic
// Transparency", section 3.1, found that sums and products of integers have that property; these are the first two of
// their hash. Of two numbers that part at a digit, what follows it is uniform for `shift` and `factor` that are, and
// variances know of pairs alone: they are those of Owen's scrambling.
uint scrambled(uint digits, uint shift, uint factor)
{
    return (digits + shift) * (factor | 1u);
}

// The second number of Sobol's sequence from the first, both with their first digits lowest: Pascal's triangle modulo 2
// (Sobol 1967). Digit k is the sum of the digits j of which k is a part, bit by bit (Lucas 1878), which takes one step
// for each bit of their places.
uint second_digits(uint digits)
{
    digits ^= (digits >> 1u) & 0x55555555u;
    digits ^= (digits >> 2u) & 0x33333333u;
    digits ^= (digits >> 4u) & 0x0f0f0f0fu;
    digits ^= (digits >> 8u) & 0x00ff00ffu;
    return digits ^ (digits >> 16u);
}

// What seeds the scrambles of the next call: the state of the generator of lib/random.glsl, which every sample of a
// pixel begins alike, and its output.
uvec2 next_seeds()
{
    uint before = rng_state;
    rng_state = before * 747796405u + 2891336453u;
    uint permuted = ((before >> ((before >> 28u) + 4u)) ^ before) * 277803737u;
    return uvec2(before, (permuted >> 22u) ^ permuted);
}

// In [0, 1), of digits whose first is the highest bit: the first 24, all that a float32 holds exactly.
float fraction(uint digits)
{
    return float(digits >> 8u) * (1.0 / 16777216.0);
}

void seed_sample(uvec2 stream, uint index)
{
    rng_state = stream.x;
    sobol_index = bitfieldReverse(index);
}

// The index that is shuffled, as digits behind the point: with the point's place in its cell one for all samples.
float rand()
{
    uvec2 seeds = next_seeds();
    return fraction(scrambled(sobol_index, seeds.x, seeds.y));
}

vec2 rand2()
{
    uvec2 seeds = next_seeds();
    uint digits = bitfieldReverse(scrambled(sobol_index, seeds.x, seeds.y));
    uint first = scrambled(digits, seeds.y, seeds.x >> 16u);
    uint second = scrambled(second_digits(digits), seeds.x ^ (seeds.y >> 16u), seeds.y >> 8u);
    return vec2(fraction(bitfieldReverse(first)), fraction(bitfieldReverse(second)));
}
