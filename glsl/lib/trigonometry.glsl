// Sine and cosine of small angles without the range reduction of the built-in ones, which costs software drivers more
// than the rest: 3 to 6 % of a frame where every path needs one.
#ifndef LIB_TRIGONOMETRY
#define LIB_TRIGONOMETRY

// (cos x, sin x) for |x| <= π/4, to 1e-7: Moshier 1989, "Methods and Programs for Mathematical Functions" (Cephes),
// sinf and cosf.
vec2 cos_sin(float x)
{
    float z = x * x;
    float c = ((2.443315711809948e-5 * z - 1.388731625493765e-3) * z + 4.166664568298827e-2) * (z * z) - 0.5 * z + 1.0;
    float s = ((-1.9515295891e-4 * z + 8.3321608736e-3) * z - 1.6666654611e-1) * (z * x) + x;
    return vec2(c, s);
}

#endif
