// Spheres displaced along their radius, met by rays that march no farther than the surface can be.
//
// In units of the sphere's radius and about its centre, the surface is p = e r(e) over unit directions e. Along a ray
// p(x) = foot + x d, with d perpendicular to the foot and b = |foot|, lie the distance ρ = √(b² + x²) from the centre and
// the angle φ with dφ/dx = b/ρ², so for f = ρ - r
//
//     f' = x/ρ - r_φ b/ρ²,    f'' = b²/ρ³ - r_φφ b²/ρ⁴ + 2 r_φ b x/ρ⁴.
//
// With |r_φ| <= slope and |r_φφ| <= bend everywhere, f'' is bounded over any step on which ρ does not fall below a known
// value. A parabola of that bend through f and f' stays below |f|: up to where it reaches zero there is no root. Near
// the surface, stepping there is Newton's method from one side: it converges quadratically and never passes a root.
// (Sphere tracing, Hart 1996, doi:10.1007/s003710050084, steps |f| / slope: here that takes four times as many steps.)
//
// Far from the surface f bends much less than it might, so a ray goes farther than that, and the point where it arrives
// proves the stretch behind it free by a parabola of its own, or else it goes back: Keinert et al. 2014, "Enhanced
// Sphere Tracing", section 3.1, with parabolas for spheres. That saves another 40 % of the steps.
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
// to step, so that a ray that creeps along the surface comes to an end: after 60 steps to 4e-5, after 128 to 1e-3.
const float MARCH_TOLERANCE = 2e-6;
const float MARCH_TOLERANCE_GROWTH = 1.05;
// How much farther than a parabola reaches; nearly 2, where the stretch behind would be proven only just.
const float MARCH_RELAXATION = 1.8;
// But no nearer to where the tangent of f reaches zero than this part of the way: the surface is likely there.
const float MARCH_TANGENT = 0.9;
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
    float x, end;        // where the ray enters the shell, or starts in it, and where it leaves it
    float inner;         // half the chord through the ball that lies inside the surface everywhere
    float side;          // 1 where it comes from outside, -1 from the ball inside, 0 where it starts in the shell
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
    a.side = start <= -a.end ? 1.0 : abs(start) < a.inner ? -1.0 : 0.0;
    a.x = a.side > 0.0 ? -a.end : a.side < 0.0 ? a.inner : start;
    return a;
}

// How far from a point with |f| = height and its derivative `rise` in a direction the ray is certain to meet nothing.
float parabola_reach(float height, float rise, float bend)
{
    float root = sqrt(max(rise * rise + 2.0 * bend * height, 0.0));
    return rise < 0.0 ? 2.0 * height / (root - rise) : (rise + root) / bend;  // neither form cancels
}

// The distance to the nearest hit within `reach` with the displaced spheres whose bits are in `left`, or `reach`; `id`
// is the shape that it is on.
float hit_displaced(vec3 o, vec3 d, uint left, float reach, out int id)
{
    float t = reach;
    id = -1;
    int current = nearest_shell(o, d, t, left);
    Approach a = approach(current, o, d);
    float x = a.x;
    float proven = x;            // up to here there is no root
    float per_lowest = 1.0;      // 1 / the lowest ρ ahead of the last point from which `proven` moved
    float side = a.side;         // 1 outside the surface, -1 inside, 0 before that is known
    bool relaxed = true;
    float tolerance = MARCH_TOLERANCE;
    for (int i = 0; i < MAX_MARCH_STEPS && current >= 0; ++i) {
        float rho2 = a.b * a.b + x * x;
        float per_rho = inversesqrt(rho2);
        float rho = rho2 * per_rho;
        float cosine = x * per_rho;
        vec3 e = (a.foot + x * d) * per_rho;
        Relief here = relief(current, e);
        float f = rho - here.r;
        float t_slope = (dot(here.gradient, d) - dot(here.gradient, e) * cosine) * per_rho;
        if (side == 0.0) {
            // On the surface itself, the side that the ray goes to.
            float way = abs(f) < MARCH_TOLERANCE ? cosine - here.slope * t_slope : f;
            side = way < 0.0 ? -1.0 : 1.0;
        }
        f *= side;
        // The slope of the ramp may change: ahead and behind, the one that leads soonest to the surface.
        float least = side * here.least * t_slope;
        float greatest = side * here.greatest * t_slope;
        float bend = a.sphere.bend + 2.0 * a.sphere.axis_bend / here.axis;  // up to half way to the axis

        float turn = a.b * per_lowest * per_lowest;  // of φ in a unit of x, at most
        float f2 = (bend * turn + (2.0 * a.sphere.slope + a.b) * per_lowest) * turn + 1e-6;
        float behind = min(parabola_reach(f, min(least, greatest) - side * cosine, f2), 0.5 * here.axis / turn);
        bool overshot = x > proven && (f < 0.0 || behind < x - proven);

        bool met = false;
        if (overshot) {
            x = proven;
        } else {
            float f1 = side * cosine - max(least, greatest);
            per_lowest = 1.0 / (x > 0.0 ? rho : max(a.b, a.sphere.lowest));
            turn = a.b * per_lowest * per_lowest;
            f2 = (bend * turn + (2.0 * a.sphere.slope + a.b) * per_lowest) * turn + 1e-6;
            float ahead = min(parabola_reach(f, f1, f2), 0.5 * here.axis / turn);
            // By the slope alone, which needs no bend: outside, x/ρ only grows.
            float descent = a.sphere.slope * turn - (side > 0.0 ? cosine : -1.0);
            ahead = max(max(ahead, descent > 0.0 ? f / descent : NO_HIT), SMALLEST_STEP);
            met = f1 < 0.0 && f < tolerance || i == MAX_MARCH_STEPS - 1;
            if (met) {
                t = a.along + x * a.sphere.radius;
                id = current;
                vec3 gradient = here.slope * here.gradient;
                displaced_normal = normalize(e - (gradient - dot(gradient, e) * e) * per_rho);
            }
            float farther = relaxed ? MARCH_RELAXATION * ahead : ahead;
            if (f1 < 0.0)
                farther = max(ahead, min(farther, -MARCH_TANGENT * f / f1));
            // The ball within the surface holds no root, but smaller ρ than the bounds know of.
            bool before_ball = a.inner > 0.0 && x <= -a.inner;
            proven = x + ahead;
            x = min(x + farther, before_ball ? -a.inner : a.end);
            if (before_ball && proven > -a.inner)
                x = proven = a.inner;
        }
        relaxed = !overshot;
        tolerance *= MARCH_TOLERANCE_GROWTH;
        if (met || proven >= a.end || a.along + proven * a.sphere.radius >= t) {
#if DISPLACED_SPHERES > 1
            current = nearest_shell(o, d, t, left);
            a = approach(current, o, d);
            x = proven = a.x;
            side = a.side;
            tolerance = MARCH_TOLERANCE;
#else
            break;
#endif
        }
    }
    return t;
}

#endif
