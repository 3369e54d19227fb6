// EXHIBIT, wrong on purpose. The handout's pdf of a direction drawn from the Phong lobe:
//
//     (α+1) (r·l)^α / π²          right: (α+1) (r·l)^α / (2π)
//
// ∫ (r·l)^α over the hemisphere about r is 2π/(α+1), so this integrates to 2/π = 0.64 and not to 1. Whatever is divided
// by it comes out π/2 times too bright: the lobe's contribution grows by 57 %, whatever the exponent.
float pdf_lobe(float cos_to_axis, float alpha)
{
    return cos_to_axis > 0.0 ? (alpha + 1.0) * pow(cos_to_axis, alpha) / (PI * PI) : 0.0;
}
