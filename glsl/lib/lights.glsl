// Light sampling: for every shape that shines a direction from o towards it, and the pdf that this has per steradian.
//
// sample_x stands above pdf_x: of the light that a ray has met by itself, the density with which sample_x would have sent
// one there from the same o, which is what multiple importance sampling weighs by. o lies in the space in which the shape
// rests, and directions are turned back by whoever calls.
//
// Of a flat shape, a cube or a cylinder a point is drawn, evenly over what faces o. Per steradian, a density per area is
// larger by distance² / cos θ at the light; with the height h of o above the light's plane there, cos θ = h / distance.
// Balls are drawn by the directions that they cover: Shirley, Wang & Zimmerman 1996, "Monte Carlo Techniques for Direct
// Lighting Calculations", ACM TOG 15(1). From inside a closed shape every direction meets it.
#ifndef LIB_LIGHTS
#define LIB_LIGHTS

#include "lib/sampling.glsl"

const float INV_FOUR_PI = 0.0795774715459477;
// A point drawn on a light is met a little before or behind where it was drawn; what is met nearer by more than this part
// of the way hides it, and may be the light's own other side.
const float NEARLY = 0.9999;

// A direction towards a light. `pdf` per steradian, 0 where no light comes from there; the light is seen where it is what
// the ray meets first, at the distance `least` or behind.
struct LightSample {
    vec3 l;
    float pdf;
    float least;
};

// The direction to y, a point drawn with density 1 / area, where o is at `height` above the light's plane. Nothing where
// that is negative: light leaves fronts only.
LightSample towards(vec3 o, vec3 y, float height, float area)
{
    vec3 way = y - o;
    float squared = dot(way, way);
    float distance = sqrt(squared);
    float pdf = height > 0.0 ? squared * distance / (area * height) : 0.0;
    return LightSample(way / distance, pdf, NEARLY * distance);
}

// The density per steradian of a point drawn with 1 / area, met at distance t, where the ray makes the cosine `facing`.
float pdf_area(float t, float facing, float area)
{
    return t * t / (area * facing);
}

// 1 - cos of the angle at which a ball of this centre and radius² is seen; 2, all directions, from inside: something of it
// may lie anywhere there.
float ball_cap(vec3 o, vec3 center, float squared_radius)
{
    vec3 way = center - o;
    float squared_sine = squared_radius / dot(way, way);
    return squared_sine < 1.0 ? squared_sine / (1.0 + sqrt(1.0 - squared_sine)) : 2.0;
}

// Of what fills a ball, or lies in it, the directions that the ball covers. Small ones too: nothing cancels in 1 - cos.
LightSample sample_ball(vec3 o, vec3 center, float squared_radius, vec2 u)
{
    float cap = ball_cap(o, center, squared_radius);
    float height = u.x * cap;  // 1 - cos θ
    float sine = sqrt(height * (2.0 - height));
    float phi = 2.0 * PI * u.y;
    vec3 l = to_world(vec3(sine * cos(phi), sine * sin(phi), 1.0 - height), normalize(center - o));
    return LightSample(l, INV_TWO_PI / cap, 0.0);
}
float pdf_ball(vec3 o, vec3 center, float squared_radius)
{
    return INV_TWO_PI / ball_cap(o, center, squared_radius);
}

// Of a sphere, which shines outwards alone.
LightSample sample_sphere(vec3 o, vec3 center, float squared_radius, vec2 u)
{
    LightSample found = sample_ball(o, center, squared_radius, u);
    found.pdf = dot(center - o, center - o) > squared_radius ? found.pdf : 0.0;
    return found;
}

// From inside a closed shape that shines inwards: every direction.
LightSample sample_around(vec2 u, bool inside)
{
    float z = 1.0 - 2.0 * u.x;
    float sine = sqrt(max(0.0, 1.0 - z * z));
    float phi = 2.0 * PI * u.y;
    return LightSample(vec3(sine * cos(phi), sine * sin(phi), z), inside ? INV_FOUR_PI : 0.0, 0.0);
}

// Of a rectangle: its middle, half its edges, and its unit normal.
LightSample sample_rectangle(vec3 o, vec3 middle, vec3 edge_x, vec3 edge_y, vec3 n, float area, vec2 u)
{
    vec3 y = middle + (2.0 * u.x - 1.0) * edge_x + (2.0 * u.y - 1.0) * edge_y;
    return towards(o, y, dot(o - middle, n), area);
}

// Of a disk, round or not: an affine map leaves the density even.
LightSample sample_disk_light(vec3 o, vec3 middle, vec3 edge_x, vec3 edge_y, vec3 n, float area, vec2 u)
{
    vec2 at = sample_disk(u);
    return towards(o, middle + at.x * edge_x + at.y * edge_y, dot(o - middle, n), area);
}

// Of a cube's three pairs of faces, the areas of those that face o, which is q in the cube's space; `areas` of one of each.
vec3 faces_seen(vec3 q, vec3 areas)
{
    return mix(vec3(0.0), areas, greaterThan(abs(q), vec3(1.0)));
}

// Of a cube: its middle, its half axes, the distances of its faces from the middle, and o in its space.
LightSample sample_cube(vec3 o, vec3 q, vec3 middle, mat3 axes, vec3 areas, vec3 sizes, vec2 u)
{
    vec3 seen = faces_seen(q, areas);
    float area = seen.x + seen.y + seen.z;
    // The face is chosen by its area, and what is left of the number is the first coordinate on it.
    float at = u.x * area;
    bool on_x = at < seen.x;
    bool on_y = !on_x && at < seen.x + seen.y;
    float a = 2.0 * (on_x ? at / seen.x : on_y ? (at - seen.x) / seen.y : (at - seen.x - seen.y) / seen.z) - 1.0;
    float b = 2.0 * u.y - 1.0;
    vec3 side = sign(q);
    vec3 heights = (abs(q) - 1.0) * sizes;
    vec3 p = on_x ? vec3(side.x, a, b) : on_y ? vec3(a, side.y, b) : vec3(a, b, side.z);
    float height = on_x ? heights.x : on_y ? heights.y : heights.z;
    return towards(o, middle + axes * p, area > 0.0 ? height : 0.0, area);
}
float pdf_cube(vec3 q, vec3 areas, float t, float facing)
{
    vec3 seen = faces_seen(q, areas);
    return pdf_area(t, facing, seen.x + seen.y + seen.z);
}

// Half the angle of a cylinder's outside that faces what is `away` radii from its axis: cos = 1 / away.
float cylinder_arc(float away)
{
    return away > 1.0 ? atan(sqrt(away * away - 1.0)) : 0.0;
}

// Of a cylinder, outside (side 1) or inside (-1), where all of it faces whatever is inside or sees in through an end. Its
// foot, its axes, its radius, half its area over π, and o in its space.
LightSample sample_cylinder(vec3 o, vec3 q, vec3 foot, mat3 axes, float radius, float half_area, float side, vec2 u)
{
    float away = length(q.xy);
    float arc = side > 0.0 ? cylinder_arc(away) : PI;
    float phi = (2.0 * u.x - 1.0) * arc;
    vec2 to = away > 0.0 ? q.xy / away : vec2(1.0, 0.0);
    vec2 c = vec2(cos(phi), sin(phi));
    vec3 p = vec3(c.x * to - c.y * vec2(to.y, -to.x), u.y);
    return towards(o, foot + axes * p, side * radius * (away * c.x - 1.0), 2.0 * arc * half_area);
}
float pdf_cylinder(vec3 q, float half_area, float side, float t, float facing)
{
    float arc = side > 0.0 ? cylinder_arc(length(q.xy)) : PI;
    return pdf_area(t, facing, 2.0 * arc * half_area);
}

#endif
