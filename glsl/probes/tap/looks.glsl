// Taps of what the generated scene says of a place: texture coordinates, material, emission; and of the environment.

vec2 tap_surface_uv(int id, vec3 p)
{
    tap_place(id, p);
    tap_uv = surface_uv(id, p);
    if (tap_here())
        tap_at_vertex(TAP_SURFACE).xy = tap_uv;
    return tap_uv;
}
#define surface_uv tap_surface_uv

#if HAS_PROCEDURAL
void tap_evaluate_procedural(int id, vec3 p)
{
    tap_place(id, p);
    evaluate_procedural(id, p);
}
#define evaluate_procedural tap_evaluate_procedural
#endif

Material tap_material(int id, vec3 p, vec2 uv)
{
    tap_place(id, p + vec3(uv - tap_uv, 0.0));
    return material(id, p, uv);
}
#define material tap_material

#if HAS_EMISSION
vec3 tap_emission(int id, vec3 p, vec2 uv)
{
    tap_place(id, p + vec3(uv - tap_uv, 0.0));
    tap_call(TAP_CALLED_EMISSION);
    vec3 value = emission(id, p, uv);
    if (tap_here())
        tap_at_vertex(TAP_LIGHT).xyz = value;
    return value;
}
#define emission tap_emission
#endif

vec3 tap_environment(vec3 d)
{
    tap_call(TAP_CALLED_ENVIRONMENT);
    vec3 value = environment(d);
    if (tap_here()) {
        tap_at_vertex(TAP_LIGHT).xyz = value;
        tap_at_vertex(TAP_SURFACE).w = tap_apart(d, tap_d);
    }
    return value;
}
#define environment tap_environment
