// EXHIBIT, wrong on purpose. What becomes of lobe samples that fall below the surface, a question that the handout
// leaves open. BELOW chooses: 0 kept with their negative cosine, 1 folded up about the surface, 2 drawn again until one
// falls above, 3 clamped to the surface.
//
//     ks (n·l), for every l       right: n·l > 0 ? ks (n·l) : 0, and the pdf as it is
//
// The weight f (n·l) / pdf is written with the lobe cancelled against its pdf. The BRDF is zero below the surface, so a
// sample there has drawn nothing: its weight is 0, and it still counts among the N.
vec3 sample_phong(Material m, vec3 n, vec3 v, out vec3 l)
{
    vec3 mirror = 2.0 * dot(n, v) * n - v;
    l = sample_lobe(mirror, m.alpha, rand2());
#if BELOW == 1
    l -= 2.0 * min(dot(n, l), 0.0) * n;
#elif BELOW == 2
    for (int draw = 1; draw < 100 && dot(n, l) <= 0.0; ++draw)
        l = sample_lobe(mirror, m.alpha, rand2());
#elif BELOW == 3
    l = normalize(l - min(dot(n, l), 0.0) * n);
#endif
    return m.ks * dot(n, l);
}
