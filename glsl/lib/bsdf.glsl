// A surface as lib/path.glsl sees it: a direction drawn, and value and density of one that is given. Another BSDF takes
// lib/phong.glsl's place behind these three.
#ifndef LIB_BSDF
#define LIB_BSDF

#include "lib/phong.glsl"
#include "lib/interface.glsl"

// A direction l, the weight f (n·l) / pdf of a path that goes on along it, and its density per steradian. Strategies divide
// by their densities where that is cheapest (the cosine cancels, `lobes` has one for each term), so the weight stands by
// itself. The density is there where it weighs anything, LIGHTS being LIGHTS_MIS; elsewhere it is undefined.
struct Scatter {
    vec3 l;
    vec3 weight;
    float pdf;
};

// f(l, v), without the cosine.
vec3 eval_bsdf(Material m, vec3 n, vec3 v, vec3 l)
{
    return eval_phong(m, dot(2.0 * dot(n, v) * n - v, l));
}

// The density per steradian with which sample_bsdf draws l.
float pdf_bsdf(Material m, vec3 n, vec3 v, vec3 l)
{
    return pdf_phong(m, n, v, l);
}

// Draws a direction for the light that leaves along v. The weight is zero below the surface.
Scatter sample_bsdf(Material m, vec3 n, vec3 v)
{
    Scatter drawn;
    drawn.weight = sample_phong(m, n, v, drawn.l);
#if LIGHTS == LIGHTS_MIS
    drawn.pdf = pdf_phong(m, n, v, drawn.l);
#endif
    return drawn;
}

#endif
