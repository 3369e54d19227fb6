// Taps of lib/phong.glsl: what sample_phong is given and draws, and the functions that it is made of, asked about that.

#if TAP_HAS_OFFSET
vec3 offset_origin(vec3 p, vec3 n);
#endif

vec3 tap_sample_phong(Material m, vec3 n, vec3 v, out vec3 l)
{
    tap_call(TAP_CALLED_SCATTER);
    tap_askew = max(tap_askew, max(tap_apart(v, -tap_d), min(tap_apart(n, tap_n), tap_apart(n, -tap_n))));
    int before = tap_drawn;
    if (tap_here()) {
        tap_at_vertex(TAP_FACING) = vec4(n, tap_askew);
        tap_at_vertex(TAP_DIFFUSE) = vec4(m.kd, m.alpha);
        tap_at_vertex(TAP_GLOSSY) = vec4(m.ks, m.p_glossy);
#if TAP_HAS_STATE
        tap_at_vertex(TAP_STATES).xy = tap_halves(rng_state);
#endif
    }
    tap_scattering = tap_drawn;
    vec3 weight = sample_phong(m, n, v, l);
    tap_scattering = -1;
    if (tap_here()) {
        tap_at_vertex(TAP_DIRECTION) = vec4(l, float(tap_drawn - before));
        tap_at_vertex(TAP_WEIGHT) = vec4(weight, float(before));
#if TAP_HAS_STATE
        tap_at_vertex(TAP_STATES).zw = tap_halves(rng_state);
#endif
        float cos_to_mirror = dot(2.0 * dot(n, v) * n - v, l);
#if TAP_HAS_PDFS
        tap_at_vertex(TAP_NUMBERS).zw = vec2(pdf_lobe(cos_to_mirror, m.alpha), pdf_cosine(dot(n, l)));
#endif
#if TAP_HAS_EVAL
        tap_at_vertex(TAP_BRDF) = vec4(eval_phong(m, cos_to_mirror), cos_to_mirror);
#endif
#if TAP_HAS_OFFSET
        tap_at_vertex(TAP_LIFTED) = vec4(offset_origin(tap_p, n), 1.0);
#endif
    }
    return weight;
}
#define sample_phong tap_sample_phong
