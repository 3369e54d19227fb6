// Taps of lib/sampling.glsl: by which sampler a direction is drawn, about which axis, and with which numbers.

void tap_lobe(float which, vec3 axis, float exponent, vec2 u)
{
    if (tap_here()) {
        tap_at_vertex(TAP_LOBE) = vec4(axis, exponent);
        tap_at_vertex(TAP_NUMBERS).xy = u;
#if TAP_HAS_BASIS
        tap_at_vertex(TAP_TANGENT) = vec4(to_world(vec3(1.0, 0.0, 0.0), axis), which);
        tap_at_vertex(TAP_BITANGENT).xyz = to_world(vec3(0.0, 1.0, 0.0), axis);
#else
        tap_at_vertex(TAP_TANGENT).w = which;
#endif
#if TAP_HAS_ABOUT
        tap_at_vertex(TAP_ABOUT).xyz = direction_about(axis, 0.6, u.y);
#endif
    }
}

#if TAP_HAS_SAMPLERS
vec3 tap_drew(vec3 direction)
{
    if (tap_here())
        tap_at_vertex(TAP_DRAWN) = vec4(direction, 1.0);
    return direction;
}

vec3 tap_sample_uniform(vec3 n, vec2 u)
{
    tap_lobe(1.0, n, 0.0, u);
    return tap_drew(sample_uniform(n, u));
}

vec3 tap_sample_cosine(vec3 n, vec2 u)
{
    tap_lobe(2.0, n, 1.0, u);
    return tap_drew(sample_cosine(n, u));
}

vec3 tap_sample_lobe(vec3 axis, float alpha, vec2 u)
{
    tap_lobe(3.0, axis, alpha, u);
    return tap_drew(sample_lobe(axis, alpha, u));
}

#define sample_uniform tap_sample_uniform
#define sample_cosine tap_sample_cosine
#define sample_lobe tap_sample_lobe
#endif
