// Spheres displaced along their radius, met by rays that march no farther than the surface can be.
//
// In units of the sphere's radius and about its centre, the surface is p = e r(e) over unit directions e. Along a ray
// p(x) = foot + x d, with d perpendicular to the foot and b = |foot|, lie the distance ρ = √(b² + x²) from the centre and
// the angle φ with dφ/dx = b/ρ², so for f = ρ - r
//
//     f' = x/ρ - r_φ b/ρ²,    f'' = b²/ρ³ - r_φφ b²/ρ⁴ + 2 r_φ b x/ρ⁴.
//
// With |r_φ| <= slope and |r_φφ| <= bend everywhere, f'' is bounded over any step on which ρ does not fall below a known
// value. A parabola of that bend through f and f' stays below |f|; where it reaches zero is as far as a ray may go, and
// it goes there. Near the surface this is Newton's method from one side: it converges quadratically and never passes a
// root. (Sphere tracing, Hart 1996, steps |f| / slope: three times as many steps here. Second derivatives for the step:
// Galin et al. 2020, "Segment Tracing Using Local Lipschitz Bounds", discusses such bounds.)
//
// The scene's generated code defines displaced_sphere, relief and nearest_shell (harness/tracer/displaced.py); how the
// bounds are found stands in harness/scene/displaced.py.
#ifndef LIB_DISPLACED
#define LIB_DISPLACED

#include "lib/shapes.glsl"

// Steps of one ray through all displaced spheres; of 10⁶ rays, none needed more than 110. Also the host's share of this
// loop in what the driver allows (MARCH_STEPS in harness/tracer/displaced.py).
#ifndef MAX_MARCH_STEPS
#define MAX_MARCH_STEPS 128
#endif
// Height above the surface, in radii, that counts as met: some twenty times the rounding errors of f. It grows from step
// to step, so that a ray that creeps along the surface comes to an end: after 40 steps to 1e-4.
const float MARCH_TOLERANCE = 2e-6;
const float MARCH_TOLERANCE_GROWTH = 1.1;
const float SMALLEST_STEP = 1e-6;  // radii; rounding may leave the parabola's root where the ray already is

// A displaced sphere's place and the bounds of harness.scene.displaced.Bounds.
struct DisplacedSphere {
    vec3 center;
    float radius;
    float lowest, highest;
    float slope, bend, axis_bend;
};

// The surface in one direction: r, the slope dr/dt of the colour ramp there, the least and the greatest that it has
// anywhere, the gradient of t along the direction, and the angle to the axis of wood's rings.
struct Relief {
    float r;
    float slope, least, greatest;
    vec3 gradient;
    float axis;
};

DisplacedSphere displaced_sphere(int id);
Relief relief(int id, vec3 direction);
int nearest_shell(vec3 o, vec3 d, float reach, inout uint left);

// The outward unit normal at the last hit that hit_displaced returned.
vec3 displaced_normal;

// Distance to where the ray enters the ball around a displaced sphere: 0 from inside, NO_HIT where it passes by.
float enter_shell(vec3 o, vec3 d, vec3 center, float radius)
{
    vec3 to_center = center - o;
    float along = dot(to_center, d);
    vec3 across = to_center - along * d;
    float discriminant = radius * radius - dot(across, across);
    float half_chord = sqrt(max(discriminant, 0.0));
    return discriminant > 0.0 && along + half_chord > 0.0 ? max(along - half_chord, 0.0) : NO_HIT;
}

// A ray seen from one displaced sphere: lengths in its radius, x counted from the point nearest to its centre.
struct Approach {
    DisplacedSphere sphere;
    vec3 foot;
    float b;             // |foot|
    float along;         // distance from the ray's origin to the foot, in the scene's units
    float x, end;        // where the ray is, and where it leaves the shell
    float inner;         // half the chord through the ball that lies inside the surface everywhere
    bool from_outside;   // whether it enters the shell from beyond
};

Approach approach(int id, vec3 o, vec3 d)
{
    Approach a;
    a.sphere = displaced_sphere(id);
    vec3 to_center = a.sphere.center - o;
    a.along = dot(to_center, d);
    float per_radius = 1.0 / a.sphere.radius;
    a.foot = (a.along * d - to_center) * per_radius;
    float b2 = dot(a.foot, a.foot);
    a.b = sqrt(b2);
    a.end = sqrt(max(a.sphere.highest * a.sphere.highest - b2, 0.0));
    a.inner = sqrt(max(a.sphere.lowest * a.sphere.lowest - b2, 0.0));
    float start = -a.along * per_radius;
    a.from_outside = start <= -a.end;
    a.x = max(start, -a.end);
    if (abs(a.x) < a.inner)
        a.x = a.inner;
    return a;
}

// The distance to the nearest hit within `reach` with the displaced spheres whose bits are in `left`, or `reach`; `id`
// is the shape that it is on.
float hit_displaced(vec3 o, vec3 d, uint left, float reach, out int id)
{
    float t = reach;
    id = -1;
    int current = nearest_shell(o, d, t, left);
    Approach a = approach(current, o, d);
    float side = 0.0;  // 1 outside the surface, -1 inside, 0 before that is known
    float tolerance = MARCH_TOLERANCE;
    for (int i = 0; i < MAX_MARCH_STEPS && current >= 0; ++i) {
        float rho2 = a.b * a.b + a.x * a.x;
        float per_rho = inversesqrt(rho2);
        float rho = rho2 * per_rho;
        float cosine = a.x * per_rho;
        vec3 e = (a.foot + a.x * d) * per_rho;
        Relief here = relief(current, e);
        float f = rho - here.r;
        float t_slope = (dot(here.gradient, d) - dot(here.gradient, e) * cosine) * per_rho;
        if (side == 0.0) {
            // On the surface itself, the side that the ray goes to.
            float way = abs(f) < MARCH_TOLERANCE ? cosine - here.slope * t_slope : f;
            side = way < 0.0 && !a.from_outside ? -1.0 : 1.0;
        }
        f *= side;
        // The slope of the ramp may change ahead: the one that leads soonest to the surface.
        float f1 = side * cosine - max(side * here.least * t_slope, side * here.greatest * t_slope);

        float lowest = a.x > 0.0 ? rho : max(a.b, a.sphere.lowest);  // of ρ on the step
        float per_lowest = 1.0 / lowest;
        float turn = a.b * per_lowest * per_lowest;  // of φ in a unit of x, at most
        float bend = a.sphere.bend + 2.0 * a.sphere.axis_bend / here.axis;  // up to half way to the axis
        float f2 = (bend * turn + (2.0 * a.sphere.slope + a.b) * per_lowest) * turn + 1e-6;
        float root = sqrt(max(f1 * f1 + 2.0 * f2 * f, 0.0));
        float parabola = f1 < 0.0 ? 2.0 * f / (root - f1) : (f1 + root) / f2;
        parabola = min(parabola, 0.5 * here.axis / turn);
        // By the slope alone, which needs no bend: outside, x/ρ only grows.
        float descent = a.sphere.slope * turn - (side > 0.0 ? cosine : -1.0);
        float line = descent > 0.0 ? f / descent : NO_HIT;
        float next = a.x + max(max(parabola, line), SMALLEST_STEP);

        bool met = f1 < 0.0 && f < tolerance || i == MAX_MARCH_STEPS - 1;
        if (met) {
            t = a.along + a.x * a.sphere.radius;
            id = current;
            vec3 gradient = here.slope * here.gradient;
            displaced_normal = normalize(e - (gradient - dot(gradient, e) * e) * per_rho);
        }
        // The ball within the surface holds no root, but smaller ρ than the bounds know of.
        a.x = a.x < -a.inner && next > -a.inner ? a.inner : next;
        tolerance *= MARCH_TOLERANCE_GROWTH;
        if (met || a.x >= a.end || a.along + a.x * a.sphere.radius >= t) {
#if DISPLACED_SPHERES > 1
            current = nearest_shell(o, d, t, left);
            a = approach(current, o, d);
            side = 0.0;
            tolerance = MARCH_TOLERANCE;
#else
            break;
#endif
        }
    }
    return t;
}

#endif
