// Ray-shape intersections: each returns the distance t > 0 to the nearest hit along o + t d, or NO_HIT.
// Every shape is hit from both sides. A shape's rows are those of the inverse of its to_world transform, so that
// dot(row.xyz, p) + row.w is one object-space coordinate of p; t is the same in object and world space.
#ifndef LIB_SHAPES
#define LIB_SHAPES

const float NO_HIT = 1e30;

// The nearer root in front of the ray. The discriminant is taken from the part of the centre's offset that is
// perpendicular to the ray, which does not cancel for distant spheres: Haines, Günther & Akenine-Möller 2019,
// "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems chapter 7, eq. 5.
float hit_sphere(vec3 o, vec3 d, vec3 center, float radius)
{
    vec3 to_center = center - o;
    float along = dot(to_center, d);
    vec3 across = to_center - along * d;
    float discriminant = radius * radius - dot(across, across);
    float half_chord = sqrt(max(discriminant, 0.0));
    float near = along - half_chord;
    float far = along + half_chord;
    float t = near > 0.0 ? near : far;
    return discriminant >= 0.0 && t > 0.0 ? t : NO_HIT;
}

// A sphere whose radius is large beside what is seen of it: a ground, a dome. `anchor` is a point on it, `arm` leads there
// from the centre, and `power` is |arm|² - radius², 0 but for rounding. The power of the ray's origin, its squared distance
// from the centre less the radius's square, comes from the way to the anchor: about the centre both are near radius², and
// their difference is off by radius times the float32 spacing, which lets light in where balls stand on the ground.
// And of the two roots the one that cancels is the power over the other: Haines et al., section 7.3.
float hit_large_sphere(vec3 o, vec3 d, vec3 anchor, vec3 arm, float power)
{
    vec3 q = o - anchor;
    float along = -(dot(q, d) + dot(arm, d));
    float start = dot(q, q + 2.0 * arm) + power;
    float discriminant = along * along - start;
    float sum = along + (along < 0.0 ? -1.0 : 1.0) * sqrt(max(discriminant, 0.0));
    float other = start / sum;
    float near = min(sum, other);
    float t = near > 0.0 ? near : max(sum, other);
    return t > 0.0 && discriminant >= 0.0 ? t : NO_HIT;
}

// [-1,1]² in the object-space plane z = 0.
float hit_rectangle(vec3 o, vec3 d, vec4 row_x, vec4 row_y, vec4 row_z)
{
    float t = -(dot(row_z.xyz, o) + row_z.w) / dot(row_z.xyz, d);  // infinite for a parallel ray: fails t < NO_HIT
    vec3 p = o + t * d;
    float x = dot(row_x.xyz, p) + row_x.w;
    float y = dot(row_y.xyz, p) + row_y.w;
    return t > 0.0 && t < NO_HIT && max(abs(x), abs(y)) <= 1.0 ? t : NO_HIT;
}

// The unit disk in the object-space plane z = 0.
float hit_disk(vec3 o, vec3 d, vec4 row_x, vec4 row_y, vec4 row_z)
{
    float t = -(dot(row_z.xyz, o) + row_z.w) / dot(row_z.xyz, d);
    vec3 p = o + t * d;
    float x = dot(row_x.xyz, p) + row_x.w;
    float y = dot(row_y.xyz, p) + row_y.w;
    return t > 0.0 && t < NO_HIT && x * x + y * y <= 1.0 ? t : NO_HIT;
}

// [-1,1]³ by slabs: Kay & Kajiya 1986, "Ray Tracing Complex Scenes", section 2; entry, or exit from inside.
float hit_cube(vec3 o, vec3 d, vec4 row_x, vec4 row_y, vec4 row_z)
{
    vec3 origin = vec3(dot(row_x.xyz, o) + row_x.w, dot(row_y.xyz, o) + row_y.w, dot(row_z.xyz, o) + row_z.w);
    // The addend keeps a ray parallel to a face from dividing by zero: infinity minus infinity below would make every
    // such ray hit. `precise`, or the compiler may move it into the sum of the dot product, where it vanishes.
    precise vec3 direction = vec3(dot(row_x.xyz, d), dot(row_y.xyz, d), dot(row_z.xyz, d)) + 1e-30;
    vec3 inverse = 1.0 / direction;
    vec3 middle = -origin * inverse;
    vec3 extent = abs(inverse);
    vec3 entries = middle - extent;
    vec3 exits = middle + extent;
    float entry = max(max(entries.x, entries.y), entries.z);
    float exit = min(min(exits.x, exits.y), exits.z);
    float t = entry > 0.0 ? entry : exit;
    return entry <= exit && t > 0.0 ? t : NO_HIT;
}

// The open cylinder of radius 1 about the object-space z axis, from z = 0 to 1. As for the sphere, the discriminant is
// taken from the line's distance from the axis, in the plane z = 0, which does not cancel where the ray starts far off.
float hit_cylinder(vec3 o, vec3 d, vec4 row_x, vec4 row_y, vec4 row_z)
{
    vec2 origin = vec2(dot(row_x.xyz, o) + row_x.w, dot(row_y.xyz, o) + row_y.w);
    vec2 direction = vec2(dot(row_x.xyz, d), dot(row_y.xyz, d));
    float height = dot(row_z.xyz, o) + row_z.w;
    float rise = dot(row_z.xyz, d);
    // A ray along the axis misses: with the bound its roots are 0 or far away, and not a quotient of zeros.
    float inverse = 1.0 / max(dot(direction, direction), 1e-30);
    float moment = origin.x * direction.y - origin.y * direction.x;
    float discriminant = dot(direction, direction) - moment * moment;
    float middle = -dot(origin, direction) * inverse;
    float half_chord = sqrt(max(discriminant, 0.0)) * inverse;
    float near = middle - half_chord;
    float far = middle + half_chord;
    // |2 z - 1| <= 1 is 0 <= z <= 1 in one comparison.
    bool near_hit = near > 0.0 && abs(2.0 * (height + near * rise) - 1.0) <= 1.0;
    bool far_hit = far > 0.0 && abs(2.0 * (height + far * rise) - 1.0) <= 1.0;
    float t = near_hit ? near : far;
    return discriminant >= 0.0 && (near_hit || far_hit) ? t : NO_HIT;
}

// The unit normal at p of a sphere: its centre, and 1 / radius with the side's sign. p lies off the sphere by rounding;
// a normal off unit length by as much hands that on to directions and so to the next hit, which is off by more: without
// normalize, 1.3e-5 of the light between spheres was lost.
vec3 sphere_normal(vec3 p, vec4 sphere)
{
    return normalize((p - sphere.xyz) * sphere.w);
}

// The outward unit normal at p of the cylinder x² + y² = 1: the gradient of its left side.
vec3 cylinder_normal(vec3 p, vec4 row_x, vec4 row_y)
{
    return normalize((dot(row_x.xyz, p) + row_x.w) * row_x.xyz + (dot(row_y.xyz, p) + row_y.w) * row_y.xyz);
}

// The face of [-1,1]³ that p lies on, as its outward object-space normal. One axis is picked on edge ties, since
// the sum of two would not be a unit vector.
vec3 cube_face(vec3 p, vec4 row_x, vec4 row_y, vec4 row_z)
{
    vec3 q = vec3(dot(row_x.xyz, p) + row_x.w, dot(row_y.xyz, p) + row_y.w, dot(row_z.xyz, p) + row_z.w);
    vec3 a = abs(q);
    vec3 face = a.x >= a.y && a.x >= a.z ? vec3(1, 0, 0) : a.y >= a.z ? vec3(0, 1, 0) : vec3(0, 0, 1);
    return face * sign(q);
}

// How far p lies off a surface, along the normal there, to first order; where a hit is projected onto its shape.
//
// Of a large sphere; `per_diameter` has the side's sign.
float large_sphere_height(vec3 p, vec3 anchor, vec3 arm, float power, float per_diameter)
{
    vec3 q = p - anchor;
    return (dot(q, q + 2.0 * arm) + power) * per_diameter;
}

// Of the face of [-1,1]³ that p lies on; `sizes` are the distances of the faces from the middle, in the world.
float cube_height(vec3 p, vec4 row_x, vec4 row_y, vec4 row_z, vec3 sizes)
{
    vec3 q = vec3(dot(row_x.xyz, p) + row_x.w, dot(row_y.xyz, p) + row_y.w, dot(row_z.xyz, p) + row_z.w);
    vec3 face = abs(cube_face(p, row_x, row_y, row_z));
    return dot(face, abs(q) - 1.0) * dot(face, sizes);
}

// Of the cylinder: its equation's left side over the length of its gradient.
float cylinder_height(vec3 p, vec4 row_x, vec4 row_y)
{
    vec2 q = vec2(dot(row_x.xyz, p) + row_x.w, dot(row_y.xyz, p) + row_y.w);
    vec3 gradient = q.x * row_x.xyz + q.y * row_y.xyz;
    return 0.5 * (dot(q, q) - 1.0) * inversesqrt(dot(gradient, gradient));
}

#endif
