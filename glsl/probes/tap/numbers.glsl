// Taps of lib/random.glsl: every number, the stream of the pixel, and the seed of the path.

// Every number is compared with the published generator, written out again.
float tap_rand()
{
#if TAP_HAS_STATE
    uint state = rng_state;
    float found = rand();
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    float expected = float(((word >> 22u) ^ word) >> 8u) * (1.0 / 16777216.0);
    tap_generator.x = max(tap_generator.x, abs(found - expected));
    tap_generator.y += rng_state == state * 747796405u + 2891336453u ? 0.0 : 1.0;
#else
    float found = rand();
#endif
    tap_generator.z += 1.0;
    tap_generator.w = max(tap_generator.w, found);
    if (tap_path() && tap_drawn < 4)
        tap_of_path(TAP_FIRST)[tap_drawn] = found;
    if (tap_here() && tap_scattering >= 0 && tap_drawn - tap_scattering < 4)
        tap_at_vertex(TAP_TAKEN)[tap_drawn - tap_scattering] = found;
    ++tap_drawn;
    return found;
}

vec2 tap_rand2()
{
    float first = tap_rand();
    return vec2(first, tap_rand());
}

uvec2 tap_pixel_stream(uvec2 pixel, uint replica)
{
    uvec2 stream = pixel_stream(pixel, replica);
    tap_of_path(TAP_STREAM) = vec4(tap_halves(stream.x), tap_halves(stream.y));
    return stream;
}

// A path begins: the numbers of its film point are drawn next.
void tap_seed_sample(uvec2 stream, uint index)
{
    seed_sample(stream, index);
    ++tap_sample_now;
    tap_vertex_now = -1;
    tap_drawn = 0;
    if (tap_path()) {
#if TAP_HAS_STATE
        tap_of_path(TAP_SEED) = vec4(tap_halves(index), tap_halves(rng_state));
#else
        tap_of_path(TAP_SEED) = vec4(tap_halves(index), 0.0, 0.0);
#endif
        tap_times = 0.0;
    }
}

#define rand tap_rand
#define rand2 tap_rand2
#define pixel_stream tap_pixel_stream
#define seed_sample tap_seed_sample
