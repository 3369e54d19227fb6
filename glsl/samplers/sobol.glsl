// The sampler `sobol`: numbers in place of those of lib/random.glsl, spread evenly over the samples of a pixel.
//
// Each call of rand() or rand2() is a dimension, or a pair of them, of its own: the first two of Sobol's sequence, which
// are a (0,2)-sequence, with their index shuffled and their digits scrambled by hashes. So the first 2^k samples of a
// pixel, and each next 2^k, put exactly one number into each of 2^k equal cells; and calls know nothing of one another.
// Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4): both by hashes, and dimensions padded like this.
//
// The scramble hangs on pixel and replica alone. Over replicas each number is uniform and independent of all others, so
// means are unbiased; within one replica samples are not independent of each other, which is what they are for.
uint sobol_index;  // of the sample, its lowest bit last; rng_state seeds the scrambles of a path's calls, one by one

// Random permutations of 32-bit numbers in which a digit hangs on itself and those below it alone: nested scrambling of
// numbers whose first digit is the lowest bit (Owen 1995). Laine & Karras 2011, "Stratified Sampling for Stochastic
// Transparency", found that sums and products of integers have that property, and made a hash of them.
// Of two numbers that part at a digit, all that follows it is uniform where `shift` and `factor` are: variances, which
// know of pairs alone, are those of Owen's scrambling. The whole of their hash, in every place, costs 20 % of a sample.
uint scrambled(uint digits, uint shift, uint factor)
{
    return (digits + shift) * (factor | 1u);
}

// The same of a sample's index, with one step of theirs between. Calls pair their numbers by it: without that step the
// numbers of two calls go together in some pixels, and errors, as large in the mean as they should be, have long tails (a
// kurtosis of 40 at 256 samples, and of 3.4 with it).
uint shuffled(uint digits, uint shift, uint factor)
{
    digits += shift;
    digits ^= digits * 0x05526c56u;  // Vegdahl 2021, "Building a Better LK Hash"
    return digits * (factor | 1u);
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
    return fraction(shuffled(sobol_index, seeds.x, seeds.y));
}

vec2 rand2()
{
    uvec2 seeds = next_seeds();
    uint digits = bitfieldReverse(shuffled(sobol_index, seeds.x, seeds.y));
    uint upper = seeds.y >> 16u;
    uint first = scrambled(digits, seeds.y, seeds.x >> 16u);
    uint second = scrambled(second_digits(digits), seeds.x ^ upper, upper);
    return vec2(fraction(bitfieldReverse(first)), fraction(bitfieldReverse(second)));
}
