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
// Sphere Tracing", with parabolas for spheres. That saves another 40 % of the steps.
//
// The scene's generated code defines DISPLACED_SPHERES, their number, MAX_MARCH_STEPS, whether any colour ramp HAS_CORNERS
// or any wood HAS_RINGS, and the functions declared below (harness/shader/scene/displaced.py); how the bounds are found stands
// in harness/scene/displaced.py.
#ifndef LIB_DISPLACED
#define LIB_DISPLACED

#include "lib/shapes.glsl"

// Height above the surface, in radii, that counts as met: some twenty times the rounding errors of f. It grows from step
// to step, so that a ray that creeps along the surface comes to an end: after 100 steps to 1.5e-5.
const float MARCH_TOLERANCE = 2e-6;
const float MARCH_TOLERANCE_GROWTH = 1.02;
// How much farther than a parabola reaches; nearly 2, where the stretch behind would be proven only just.
const float MARCH_RELAXATION = 1.8;
// But no nearer to where the tangent of f reaches zero than this part of the way: the surface is likely there.
const float MARCH_TANGENT = 0.9;
// How much farther from the surface than its lowest and highest points its shell reaches, in radii, some hundred times the
// rounding of x: a step that rounded past the floor of a valley, or a crest, would leave the shell, and the hit be lost.
const float SHELL_MARGIN = 2e-5;
const float SMALLEST_STEP = 1e-6;  // radii; rounding may leave the parabola's root where the ray already is
// The way to an axis, or a corner of the ramp, where there is none: no limit to any step.
const float FAR = 1e30;

// A displaced sphere's place and the bounds of harness.scene.displaced.Bounds.
struct DisplacedSphere {
    vec3 center;
    float radius;
    float lowest, highest;
    float slope, bend, axis_bend;
};

// The surface in one direction: r, the slope dr/dt of the colour ramp there, the least and the greatest that it has
// anywhere, how far t is from where the slope changes, the gradient of t along the direction, and the angle to the axis of
// wood's rings.
struct Relief {
    float r;
    float slope, least, greatest, room;
    vec3 gradient;
    float axis;
};

DisplacedSphere displaced_sphere(int id);
Relief relief(int id, vec3 direction);
int nearest_shell(vec3 o, vec3 d, float reach, inout uint left);
void carry_ray(int id, inout vec3 o, inout vec3 d);
float intersect_shapes(vec3 o, vec3 d, float reach, out int id);

// The outward unit normal at the last hit on a displaced sphere, of the sphere at rest.
vec3 displaced_normal;
// And the hit itself, of the sphere at rest too: from the foot of the ray, which rounds no more than the sphere's own size
// asks for, where o + t d rounds as much as t does.
vec3 displaced_point;

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

// A ray on its way through the displaced spheres. Of the sphere that it passes: lengths are in its radius, and x counts
// from the foot, the point of the ray that is nearest to its centre.
struct March {
    float t;             // distance to the nearest hit so far, in the scene's units, and the shape that it is on
    int id;
    uint left;           // bits of the spheres still to be passed
    int current;         // the sphere that is being passed, -1 between two
    int steps;
    DisplacedSphere sphere;
    vec3 foot;
    float b;             // |foot|
    float along;         // distance from the ray's origin to the foot, in the scene's units
    float x, end;        // where the ray is, and where it leaves the shell
    float proven;        // up to here there is no root; x lies there or ahead
    float per_lowest;    // 1 / the lowest ρ ahead of the last point from which `proven` moved
    float inner;         // half the chord through the ball that lies inside the surface everywhere
    float side;          // 1 outside the surface, -1 inside, 0 before that is known
    bool relaxed;        // whether the next step may go farther than the parabola reaches
    float tolerance;
};

March march;

// Starts a ray that meets shape `id` at t, or nothing within t where `id` is -1.
void begin_march(float t, int id)
{
    march.t = t;
    march.id = id;
    march.left = (1u << DISPLACED_SPHERES) - 1u;
    march.current = -1;
    march.steps = 0;
}

// Turns to the sphere `march.current`; the ray is that in its rest frame.
void approach(vec3 o, vec3 d)
{
    march.sphere = displaced_sphere(march.current);
    vec3 to_center = march.sphere.center - o;
    march.along = dot(to_center, d);
    float per_radius = 1.0 / march.sphere.radius;
    march.foot = (march.along * d - to_center) * per_radius;
    float b2 = dot(march.foot, march.foot);
    march.b = sqrt(b2);
    float outer = march.sphere.highest + SHELL_MARGIN;
    float inner = march.sphere.lowest - SHELL_MARGIN;
    march.end = sqrt(max(outer * outer - b2, 0.0));
    march.inner = sqrt(max(inner * inner - b2, 0.0));
    float start = -march.along * per_radius;
    march.side = start <= -march.end ? 1.0 : abs(start) < march.inner ? -1.0 : 0.0;
    march.x = march.side > 0.0 ? -march.end : march.side < 0.0 ? march.inner : start;
    march.proven = march.x;
    march.per_lowest = 1.0;
    march.relaxed = true;
    march.tolerance = MARCH_TOLERANCE;
}

// How far from a point with |f| = height and its derivative `rise` in a direction the ray is certain to meet nothing.
float parabola_reach(float height, float rise, float bend)
{
    float root = sqrt(max(rise * rise + 2.0 * bend * height, 0.0));
    bool down = rise < 0.0;  // neither form of the solution cancels; one division for both
    return (down ? 2.0 * height : rise + root) / (down ? root - rise : bend);
}

// The bound on |f''| where the angle turns by at most `turn` in a unit of x; not 0, since it divides.
float march_bend(float bend, float turn, float per_lowest)
{
    return (bend * turn + (2.0 * march.sphere.slope + march.b) * per_lowest) * turn + 1e-6;
}

// How far the ray is certain to meet nothing, ahead for way = 1 and behind for way = -1.
float certain_reach(float height, float way, float cosine, float t_slope, Relief here, float turn, float per_lowest)
{
    float outwards = way * march.side;
    float bend = march.sphere.bend;
#if HAS_RINGS
    bend += 2.0 * march.sphere.axis_bend / here.axis;  // what they bend at most, up to half way to their axis
#endif
    bend = march_bend(bend, turn, per_lowest);
    float reach = parabola_reach(height, outwards * (cosine - here.slope * t_slope), bend);
#if HAS_CORNERS
    // Up to a corner of the ramp; and beyond, by the slope that leads soonest to the surface.
    float corner = parabola_reach(here.room, -abs(t_slope), bend / max(abs(here.least), abs(here.greatest)));
    float steepest = max(outwards * here.least * t_slope, outwards * here.greatest * t_slope);
    reach = max(min(reach, corner), parabola_reach(height, outwards * cosine - steepest, bend));
#endif
#if HAS_RINGS
    reach = min(reach, 0.5 * here.axis / turn);
#endif
    return reach;
}

// One step of the ray within the shell of `march.current`.
void step_march(vec3 d)
{
    float rho2 = march.b * march.b + march.x * march.x;
    float per_rho = inversesqrt(rho2);
    float rho = rho2 * per_rho;
    float cosine = march.x * per_rho;
    vec3 e = (march.foot + march.x * d) * per_rho;
    Relief here = relief(march.current, e);
    float f = rho - here.r;
    float t_slope = (dot(here.gradient, d) - dot(here.gradient, e) * cosine) * per_rho;
    if (march.side == 0.0) {
        // On the surface itself, the side that the ray goes to.
        float way = abs(f) < MARCH_TOLERANCE ? cosine - here.slope * t_slope : f;
        march.side = way < 0.0 ? -1.0 : 1.0;
    }
    float side = march.side;
    f *= side;

    float turn = march.b * march.per_lowest * march.per_lowest;
    float behind = certain_reach(f, -1.0, cosine, t_slope, here, turn, march.per_lowest);
    float unproven = march.x - march.proven;
    bool overshot = unproven > 0.0 && (f < 0.0 || behind < unproven);
    float relaxation = march.relaxed ? MARCH_RELAXATION : 1.0;
    ++march.steps;
    march.relaxed = !overshot;
    march.tolerance *= MARCH_TOLERANCE_GROWTH;
    if (overshot) {
        march.x = march.proven;
        return;
    }

    float f1 = side * (cosine - here.slope * t_slope);
    march.per_lowest = 1.0 / (march.x > 0.0 ? rho : max(march.b, march.sphere.lowest));
    turn = march.b * march.per_lowest * march.per_lowest;
    float ahead = certain_reach(f, 1.0, cosine, t_slope, here, turn, march.per_lowest);
#if HAS_RINGS
    // By the slope alone, which holds on the axis as well: outside, x/ρ only grows.
    float descent = march.sphere.slope * turn - (side > 0.0 ? cosine : -1.0);
    ahead = max(ahead, descent > 0.0 ? f / descent : NO_HIT);
#endif
    ahead = max(ahead, SMALLEST_STEP);
    bool exhausted = march.steps >= MAX_MARCH_STEPS - 1;
    bool met = f1 < 0.0 && f < march.tolerance || exhausted;
    if (met) {
        march.t = march.along + march.x * march.sphere.radius;
        march.id = march.current;
        displaced_point = march.sphere.center + march.sphere.radius * (march.foot + march.x * d);
        vec3 gradient = here.slope * here.gradient;
        displaced_normal = normalize(e - (gradient - dot(gradient, e) * e) * per_rho);
    }
    float farther = relaxation * ahead;
    if (f1 < 0.0)
        farther = max(ahead, min(farther, -MARCH_TANGENT * f / f1));
    // The ball within the surface holds no root, but smaller ρ than the bounds know of.
    bool before_ball = march.inner > 0.0 && march.x <= -march.inner;
    march.proven = march.x + ahead;
    march.x = min(march.x + farther, before_ball ? -march.inner : march.end);
    if (before_ball && march.proven > -march.inner)
        march.x = march.proven = march.inner;
    if (met || march.proven >= march.end || march.along + march.proven * march.sphere.radius >= march.t)
        march.current = -1;
    if (exhausted)
        march.left = 0u;
}

// Goes on with the ray that begin_march started, by one step at most; whether there is more of its way.
bool march_on(vec3 o, vec3 d)
{
    bool fresh = march.current < 0;
    if (fresh)
        march.current = nearest_shell(o, d, march.t, march.left);
    carry_ray(march.current, o, d);
    if (fresh)
        approach(o, d);
    if (march.current >= 0)
        step_march(d);
    return march.current >= 0 || march.left != 0u;
}

// The distance to the nearest hit within `reach`, and the shape that it is on; -1 where there is none.
float intersect_scene(vec3 o, vec3 d, float reach, out int id)
{
    float t = intersect_shapes(o, d, reach, id);
    begin_march(t, id);
    for (int i = 0; i <= MAX_MARCH_STEPS && march_on(o, d); ++i)
        ;
    id = march.id;
    return march.t;
}

#endif
