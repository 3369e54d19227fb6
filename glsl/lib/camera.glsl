// Mitsuba's perspective camera and its thin lens: +z forward, +x left, +y up in camera space. The generated scene defines
// CAMERA_START (the middle of the near plane; from the camera's own place, sums of near-plane distances lose the digits that
// a distant camera's rays need), CAMERA_LEFT, CAMERA_UP, CAMERA_FORWARD, CAMERA_TAN (half extents at distance 1),
// CAMERA_OFFSET (principal point), CAMERA_NEAR and CAMERA_FAR (planes at those depths); and where HAS_LENS is 1,
// CAMERA_APERTURE (radius of the lens) and CAMERA_FOCUS (depth of the plane that is sharp).
#ifndef LIB_CAMERA
#define LIB_CAMERA

#include "lib/sampling.glsl"

// The ray through `film` in [0,1]², (0,0) at the bottom left, from the near plane; `reach` is its length to the
// far plane.
void camera_ray(vec2 film, out vec3 o, out vec3 d, out float reach)
{
    vec2 plane = vec2(1.0 - 2.0 * film.x, 2.0 * film.y - 1.0) * CAMERA_TAN + CAMERA_OFFSET;
    d = plane.x * CAMERA_LEFT + plane.y * CAMERA_UP + CAMERA_FORWARD;
    float slant = length(d);  // distance per unit of depth
    d *= 1.0 / slant;  // one division: compilers make three of a vector by a scalar
    o = CAMERA_START + CAMERA_NEAR * (plane.x * CAMERA_LEFT + plane.y * CAMERA_UP);
    reach = (CAMERA_FAR - CAMERA_NEAR) * slant;
}

#if HAS_LENS
// The ray that leaves a point of the lens, which `u` in [0,1)² picks, and meets the pinhole's ray through `film` in the
// plane of focus; from the near plane to the far plane, as above.
void lens_ray(vec2 film, vec2 u, out vec3 o, out vec3 d, out float reach)
{
    vec2 lens = CAMERA_APERTURE * sample_disk(u);
    // `precise`, or a compiler multiplies the lens's two constants first, and as uniforms they would give other bits.
    precise vec2 plane = vec2(1.0 - 2.0 * film.x, 2.0 * film.y - 1.0) * CAMERA_TAN - (1.0 / CAMERA_FOCUS) * lens;
    d = plane.x * CAMERA_LEFT + plane.y * CAMERA_UP + CAMERA_FORWARD;
    float slant = length(d);
    d *= 1.0 / slant;
    vec2 start = lens + CAMERA_NEAR * plane;
    o = CAMERA_START + (start.x * CAMERA_LEFT + start.y * CAMERA_UP);
    reach = (CAMERA_FAR - CAMERA_NEAR) * slant;
}
#endif

#endif
