// EXHIBIT. The handout's BRDF on its own, which is right; lobe_pdf.glsl needs it beside a pdf that is not.
//
//     f(l, v) = kd/π + ks (α+1)/(2π) max(r·v, 0)^α
//
// The library writes the lobe of the BRDF and the lobe's pdf as one function, since they are the same number. In the
// handout they are two formulas with different constants.
vec3 eval_phong(Material m, float cos_to_mirror)
{
    float lobe = cos_to_mirror > 0.0 ? pow(cos_to_mirror, m.alpha) : 0.0;
    return m.kd * INV_PI + m.ks * (m.alpha + 1.0) * INV_TWO_PI * lobe;
}
