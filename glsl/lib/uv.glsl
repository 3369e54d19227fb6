// Surface coordinates (u, v) as Mitsuba defines them, from points q in a shape's canonical object space.
#ifndef LIB_UV
#define LIB_UV

// The angle of (x, y) in turns, within [-1/2, 1/2]; 0 at the origin. Off by 4e-8 turns at most, and faster than the
// atan of drivers, which may be off by thousands of a texel (llvmpipe's by 5e-7 turns). The polynomial is the minimax
// one for atan(r) / (2π) on [0, 1] of degree 13, odd.
float turns(float y, float x)
{
    float smaller = min(abs(x), abs(y));
    float larger = max(max(abs(x), abs(y)), 1e-30);
    float r = smaller / larger;
    float s = r * r;
    float angle = r * (0.15915432 + s * (-0.05302624 + s * (0.03152512 + s * (-0.02106151 + s * (0.01267249
        + s * (-0.00534827 + s * 0.00108413))))));
    angle = abs(y) > abs(x) ? 0.25 - angle : angle;
    angle = x < 0.0 ? 0.5 - angle : angle;
    return y < 0.0 ? -angle : angle;
}

// The same within [0, 1).
float whole_turns(float y, float x)
{
    float angle = turns(y, x);
    return angle < 0.0 ? angle + 1.0 : angle;
}

// u around the z axis from +x towards +y, v from the pole +z down; of any distance from the centre.
vec2 uv_sphere(vec3 q)
{
    return vec2(whole_turns(q.y, q.x), 2.0 * turns(length(q.xy), q.z));
}

vec2 uv_rectangle(vec3 q)
{
    return 0.5 + 0.5 * q.xy;
}

// Polar: u the radius, v around.
vec2 uv_disk(vec3 q)
{
    return vec2(length(q.xy), whole_turns(q.y, q.x));
}

vec2 uv_cylinder(vec3 q)
{
    return vec2(whole_turns(q.y, q.x), q.z);
}

// Each face is covered once; their axes are those of Mitsuba's cube mesh.
vec2 uv_cube(vec3 q)
{
    vec3 a = abs(q);
    vec2 x_face = vec2(q.y, q.x > 0.0 ? -q.z : q.z);
    vec2 y_face = q.y > 0.0 ? -q.xz : q.zx;
    vec2 z_face = vec2(q.z > 0.0 ? q.y : -q.y, q.x);
    return 0.5 + 0.5 * (a.x >= a.y && a.x >= a.z ? x_face : a.y >= a.z ? y_face : z_face);
}

#endif
