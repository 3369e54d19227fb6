// EXHIBIT, wrong on purpose. The handout's clamp of the mirror direction itself, a vec3:
//
//     max(reflect(l,n),0.0)       right: max(dot(r, v), 0.0) with r = reflect(-l, n)
//
// The cosine between the mirror direction and the viewer is missing. GLSL has a max(vec3, float), so it is only where
// the result must be a number that the compiler objects. Around it stands the course's first estimator: l is drawn
// uniformly over the hemisphere, pdf 1/(2π).
vec3 sample_phong(Material m, vec3 n, vec3 v, out vec3 l)
{
    l = sample_uniform(n, rand2());
    float cosine = max(reflect(l,n),0.0);
    vec3 f = m.kd / PI + m.ks * (m.alpha + 1.0) / (2.0 * PI) * pow(cosine, m.alpha);
    return f * max(dot(n, l), 0.0) / INV_TWO_PI;
}
