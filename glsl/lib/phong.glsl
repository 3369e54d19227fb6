// The course's Phong-like BRDF, and the five strategies that draw directions for it.
//
//     f(l, v) = kd/π + ks (α+1)/(2π) max(r·v, 0)^α,   r the mirror image of l about n
//
// with the course's normalisation, α+1 and not the energy-conserving α+2. The mirror is symmetric, so the same
// lobe is max(r·l, 0)^α with r the mirror image of v; it is in that form that the lobe can be sampled.
// Directions l (to the light) and v (to the viewer) point away from the surface. f does not include the cosine.
#ifndef LIB_PHONG
#define LIB_PHONG

#include "lib/random.glsl"
#include "lib/sampling.glsl"

#define STRATEGY_UNIFORM 0
#define STRATEGY_COSINE 1
#define STRATEGY_PHONG 2
#define STRATEGY_LOBES 3
#define STRATEGY_MIXTURE 4
#ifndef STRATEGY
#define STRATEGY STRATEGY_MIXTURE
#endif

// Which terms any material of the scene has; a scene without one leaves its code out.
#ifndef HAS_DIFFUSE
#define HAS_DIFFUSE 1
#endif
#ifndef HAS_GLOSSY
#define HAS_GLOSSY 1
#endif

struct Material {
    vec3 kd;          // diffuse albedo
    vec3 ks;          // specular coefficient
    float alpha;      // exponent
    float p_glossy;   // probability of drawing from the lobe where a strategy chooses between the two terms
};

// The lobe's share of what the two terms reflect at most, by the largest channel. As tracer/materials.py has it for
// constants and reference/phong.py for the reference.
float glossy_probability(vec3 kd, vec3 ks)
{
    float diffuse = max(max(kd.r, kd.g), kd.b);
    float glossy = max(max(ks.r, ks.g), ks.b);
    return diffuse + glossy > 0.0 ? glossy / (diffuse + glossy) : 0.0;
}

vec3 eval_phong(Material m, float cos_to_mirror)
{
    vec3 f = vec3(0.0);
#if HAS_DIFFUSE
    f += m.kd * INV_PI;
#endif
#if HAS_GLOSSY
    f += m.ks * pdf_lobe(cos_to_mirror, m.alpha);  // the lobe's pdf is its normalised shape
#endif
    return f;
}

// Draws l and returns its weight f (n·l) / pdf. Zero where l falls below the surface.
vec3 sample_phong(Material m, vec3 n, vec3 v, out vec3 l)
{
    vec3 mirror = 2.0 * dot(n, v) * n - v;
#if STRATEGY == STRATEGY_UNIFORM
    l = sample_uniform(n, rand2());
    float cos_l = dot(n, l);
    return eval_phong(m, dot(mirror, l)) * (max(cos_l, 0.0) / INV_TWO_PI);

#elif STRATEGY == STRATEGY_COSINE || (!HAS_GLOSSY && STRATEGY != STRATEGY_PHONG)
    l = sample_cosine(n, rand2());
#if HAS_GLOSSY
    return eval_phong(m, dot(mirror, l)) * PI;  // the cosine cancels against its pdf
#else
    return m.kd;
#endif

#elif STRATEGY == STRATEGY_PHONG
    l = sample_lobe(mirror, m.alpha, rand2());
    float cos_l = dot(n, l);
    float cos_to_mirror = dot(mirror, l);
    float pdf = pdf_lobe(cos_to_mirror, m.alpha);
    return cos_l > 0.0 && pdf > 0.0 ? eval_phong(m, cos_to_mirror) * (cos_l / pdf) : vec3(0.0);

#else
    // One draw for both terms: the cosine hemisphere is the lobe with exponent 1 about n (see sample_lobe).
    bool glossy = rand() < m.p_glossy;
    l = sample_lobe(glossy ? mirror : n, glossy ? m.alpha : 1.0, rand2());
    float cos_l = dot(n, l);
    if (cos_l <= 0.0)
        return vec3(0.0);
#if STRATEGY == STRATEGY_LOBES
    // Each term against its own pdf: kd/π cos / (cos/π) = kd, and ks lobe cos / lobe = ks cos.
    return glossy ? m.ks * (cos_l / m.p_glossy) : m.kd * (1.0 / (1.0 - m.p_glossy));
#else
    float cos_to_mirror = dot(mirror, l);
    float pdf = (1.0 - m.p_glossy) * pdf_cosine(cos_l) + m.p_glossy * pdf_lobe(cos_to_mirror, m.alpha);
    return eval_phong(m, cos_to_mirror) * (cos_l / pdf);
#endif
#endif
}

// The density, per steradian, with which sample_phong draws l; what lies below the surface counts with it.
float pdf_phong(Material m, vec3 n, vec3 v, vec3 l)
{
#if STRATEGY == STRATEGY_UNIFORM
    return pdf_uniform(dot(n, l));
#elif STRATEGY == STRATEGY_COSINE || (!HAS_GLOSSY && STRATEGY != STRATEGY_PHONG)
    return pdf_cosine(dot(n, l));
#else
    float lobe = pdf_lobe(dot(2.0 * dot(n, v) * n - v, l), m.alpha);
#if STRATEGY == STRATEGY_PHONG
    return lobe;
#else
    return (1.0 - m.p_glossy) * pdf_cosine(dot(n, l)) + m.p_glossy * lobe;
#endif
#endif
}

#endif
