// Mitsuba's perspective camera: +z forward, +x left, +y up in camera space. The generated scene defines
// CAMERA_ORIGIN, CAMERA_LEFT, CAMERA_UP, CAMERA_FORWARD, CAMERA_TAN (half extents at distance 1),
// CAMERA_OFFSET (principal point), CAMERA_NEAR and CAMERA_FAR (planes at those depths).
#ifndef LIB_CAMERA
#define LIB_CAMERA

// The ray through `film` in [0,1]², (0,0) at the bottom left, from the near plane; `reach` is its length to the
// far plane.
void camera_ray(vec2 film, out vec3 o, out vec3 d, out float reach)
{
    vec2 plane = vec2(1.0 - 2.0 * film.x, 2.0 * film.y - 1.0) * CAMERA_TAN + CAMERA_OFFSET;
    d = plane.x * CAMERA_LEFT + plane.y * CAMERA_UP + CAMERA_FORWARD;
    float slant = length(d);  // distance per unit of depth
    d *= 1.0 / slant;  // one division: compilers make three of a vector by a scalar
    o = CAMERA_ORIGIN + (CAMERA_NEAR * slant) * d;
    reach = (CAMERA_FAR - CAMERA_NEAR) * slant;
}

#endif
