// EXHIBIT, wrong on purpose, and not in the handout: what is left of reflect.glsl once it is repaired until it compiles.
//
//     max(dot(reflect(l,n),v),0.0)       right: max(dot(reflect(-l, n), v), 0.0)
//
// GLSL's reflect(I, n) = I - 2 dot(n, I) n takes a direction that travels *towards* the surface. Here l points away from
// it, so reflect(l, n) points into the surface, no viewer is there, and the lobe is all but gone.
vec3 sample_phong(Material m, vec3 n, vec3 v, out vec3 l)
{
    l = sample_uniform(n, rand2());
    float cosine = max(dot(reflect(l,n),v),0.0);
    vec3 f = m.kd / PI + (cosine > 0.0 ? m.ks * (m.alpha + 1.0) / (2.0 * PI) * pow(cosine, m.alpha) : vec3(0.0));
    return f * max(dot(n, l), 0.0) / INV_TWO_PI;
}
