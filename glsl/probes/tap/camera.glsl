// Taps of lib/camera.glsl: the film point, the numbers of the lens, and the ray made of them.

void tap_camera(vec2 film, vec2 u, vec3 o, vec3 d, float reach)
{
    if (tap_path()) {
        tap_of_path(TAP_FILM) = vec4(film, u);
        tap_of_path(TAP_EYE) = vec4(o, reach);
        tap_of_path(TAP_GAZE).xyz = d;
    }
}

#if HAS_LENS
void tap_lens_ray(vec2 film, vec2 u, out vec3 o, out vec3 d, out float reach)
{
    lens_ray(film, u, o, d, reach);
    tap_camera(film, u, o, d, reach);
}
#define lens_ray tap_lens_ray
#else
void tap_camera_ray(vec2 film, out vec3 o, out vec3 d, out float reach)
{
    camera_ray(film, o, d, reach);
    tap_camera(film, vec2(0.0), o, d, reach);
}
#define camera_ray tap_camera_ray
#endif
