// Taps of what the generated scene says of a ray: the shape that is met, where, when, and its normal.

void tap_begin_vertex(float reach)
{
    ++tap_vertex_now;
    tap_calls = TAP_CALLED_INTERSECT;
    tap_astray = tap_askew = 0.0;
    tap_shifts = false;
    if (tap_path())
        tap_of_path(TAP_GAZE).w = float(tap_vertex_now + 1);
    if (tap_here())
        tap_at_vertex(TAP_PLACE).w = reach;
}

void tap_hit(vec3 o, vec3 d, float t, int id)
{
    tap_o = o;
    tap_d = d;
    tap_p = o + t * d;
    tap_rest = tap_p;
    tap_id = id;
    if (tap_here()) {
        tap_at_vertex(TAP_ORIGIN) = vec4(o, t);
        tap_at_vertex(TAP_RAY) = vec4(d, float(id));
        tap_at_vertex(TAP_MET).xyz = tap_p;
        tap_at_vertex(TAP_NORMAL).w = tap_calls;
    }
}

void tap_call(float which)
{
    tap_calls += which;
    if (tap_here())
        tap_at_vertex(TAP_NORMAL).w = tap_calls;
}

// A place handed on must be the one that was met, on the shape that was.
void tap_place(int id, vec3 p)
{
    tap_astray = max(tap_astray, id == tap_id ? tap_apart(p, tap_rest) : 1e30);
    if (tap_here())
        tap_at_vertex(TAP_SURFACE).z = tap_astray;
}

#if HAS_DISPLACED
float tap_intersect_shapes(vec3 o, vec3 d, float reach, out int id)
{
    tap_begin_vertex(reach);
    return intersect_shapes(o, d, reach, id);
}
#define intersect_shapes tap_intersect_shapes

bool tap_march_on(vec3 o, vec3 d)
{
    bool more = march_on(o, d);
    if (!more)
        tap_hit(o, d, march.t, march.id);
    return more;
}
#define march_on tap_march_on
#else
float tap_intersect_scene(vec3 o, vec3 d, float reach, out int id)
{
    tap_begin_vertex(reach);
    float t = intersect_scene(o, d, reach, id);
    tap_hit(o, d, t, id);
    return t;
}
#define intersect_scene tap_intersect_scene
#endif

#if HAS_MOTION
void tap_set_time(float u)
{
    set_time(u);
    if (tap_path())
        tap_of_path(TAP_TIME) = vec4(u, path_time, ++tap_times, 0.0);
    if (tap_moment >= 0.0)
        set_time(tap_moment);
}
#define set_time tap_set_time

vec3 tap_to_rest(int id, vec3 p)
{
    tap_place(id, p);
    tap_rest = to_rest(id, p);
    return tap_rest;
}
#define to_rest tap_to_rest

vec3 tap_from_rest(int id, vec3 n)
{
    if (tap_shifts) {
        vec3 shift = from_rest(id, n);
        tap_shifts = false;
        tap_p += shift;
        if (tap_here())
            tap_at_vertex(TAP_MET).xyz = tap_p;
        return shift;
    }
    tap_askew = max(tap_askew, tap_apart(n, tap_n));
    tap_n = from_rest(id, n);
    if (tap_here())
        tap_at_vertex(TAP_TURNED).xyz = tap_n;
    return tap_n;
}
#define from_rest tap_from_rest
#endif

vec3 tap_surface_normal(int id, vec3 p)
{
    tap_place(id, p);
    tap_call(TAP_CALLED_NORMAL);
    tap_n = surface_normal(id, p);
    if (tap_here()) {
        tap_at_vertex(TAP_NORMAL).xyz = tap_n;
        tap_at_vertex(TAP_PLACE).xyz = p;
        tap_at_vertex(TAP_TURNED).xyz = tap_n;
    }
    return tap_n;
}
#define surface_normal tap_surface_normal

#ifdef HAS_PROJECTION
#if HAS_PROJECTION
vec3 tap_project_hit(int id, vec3 p, vec3 n)
{
    tap_place(id, p);
    tap_askew = max(tap_askew, tap_apart(n, tap_n));
    tap_rest = project_hit(id, p, n);
#if HAS_MOTION
    tap_shifts = true;
#else
    tap_p = tap_rest;
    if (tap_here())
        tap_at_vertex(TAP_MET).xyz = tap_p;
#endif
    return tap_rest;
}
#define project_hit tap_project_hit
#endif
#endif
