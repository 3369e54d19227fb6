// Directions on the hemisphere: each sample_x(u) stands directly above the pdf_x it has, per solid angle.
// Conventions: directions are unit vectors in world space; u is uniform in [0,1)²; pdfs are per steradian.
#ifndef LIB_SAMPLING
#define LIB_SAMPLING

#include "lib/trigonometry.glsl"

const float PI = 3.14159265358979;
const float INV_PI = 0.318309886183791;
const float INV_TWO_PI = 0.159154943091895;

// Takes local coordinates, z along `axis`, to world space. Duff et al. 2017, "Building an Orthonormal Basis,
// Revisited", JCGT 6(1), listing 3: no axis is singular. (The handout's cross(w.yzx, w) vanishes at (1,1,1).) Where the
// sign changes is free, as long as s + axis.z stays far from 0. At -0.4 lies no normal of a face along the axes, whose
// z is 0 but for rounding, so that the rounding does not choose between two frames.
vec3 to_world(vec3 local, vec3 axis)
{
    float s = axis.z < -0.4 ? -1.0 : 1.0;
    float a = -1.0 / (s + axis.z);
    float b = axis.x * axis.y * a;
    vec3 tangent = vec3(1.0 + s * axis.x * axis.x * a, s * b, -s * axis.x);
    vec3 bitangent = vec3(b, s + axis.y * axis.y * a, -axis.y);
    return local.x * tangent + local.y * bitangent + local.z * axis;
}

// The direction at polar angle acos(cos_theta) and azimuth 2π u about `axis`.
vec3 direction_about(vec3 axis, float cos_theta, float u)
{
    float sin_theta = sqrt(max(0.0, 1.0 - cos_theta * cos_theta));
    float phi = 2.0 * PI * u;
    return to_world(vec3(sin_theta * cos(phi), sin_theta * sin(phi), cos_theta), axis);
}

// Uniform over the hemisphere about n: cos θ is uniform. Shirley & Chiu 1997; PBRT 4th ed., A.5.2.
vec3 sample_uniform(vec3 n, vec2 u)
{
    return direction_about(n, u.x, u.y);
}
float pdf_uniform(float cos_theta)
{
    return cos_theta > 0.0 ? INV_TWO_PI : 0.0;
}

// Proportional to the cosine about n: cos²θ is uniform. PBRT 4th ed., A.5.3.
vec3 sample_cosine(vec3 n, vec2 u)
{
    return direction_about(n, sqrt(1.0 - u.x), u.y);
}
float pdf_cosine(float cos_theta)
{
    return max(cos_theta, 0.0) * INV_PI;
}

// Proportional to cos^α about `axis`: Lafortune & Willems 1994, "Using the Modified Phong Reflectance Model for
// Physically Based Rendering", CW 197, eq. 10. The axis is the mirror direction, so part of the lobe may lie below
// the surface; such samples have weight zero and the pdf stays as it is. With α = 1 this is sample_cosine.
vec3 sample_lobe(vec3 axis, float alpha, vec2 u)
{
    return direction_about(axis, pow(1.0 - u.x, 1.0 / (alpha + 1.0)), u.y);
}
float pdf_lobe(float cos_to_axis, float alpha)
{
    // Selected on the cosine first: pow(0, 0) is undefined in GLSL, and pow of a negative base is NaN.
    return cos_to_axis > 0.0 ? (alpha + 1.0) * INV_TWO_PI * pow(cos_to_axis, alpha) : 0.0;
}

// Uniform on the unit disk, concentric squares to circles: Shirley & Chiu 1997, "A Low Distortion Map Between Disk and
// Square", JGT 2(3), in the form that Mitsuba has it in, so that equal numbers give equal points.
vec2 sample_disk(vec2 u)
{
    vec2 square = 2.0 * u - 1.0;
    bool steep = abs(square.x) < abs(square.y);
    vec2 folded = steep ? square.yx : square;
    float phi = folded.x != 0.0 ? 0.785398163397448 * folded.y / folded.x : 0.0;  // at most π/4 either way
    vec2 p = folded.x * cos_sin(phi);
    return steep ? p.yx : p;
}

#endif
