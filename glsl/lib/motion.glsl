// Rigid motion of shapes. Every shape is met, textured and lit where it rests, which is where it is at time 0; rays are
// carried there, and normals back. The generated scene defines set_time, to_rest and from_rest.
#ifndef LIB_MOTION
#define LIB_MOTION

#include "lib/trigonometry.glsl"

float path_time;  // the moment at which the current path sees the scene

// Carries a point p of a shape at rest to turn * p + shift. Its inverse takes p to (p - shift) * turn.
struct Pose {
    mat3 turn;
    vec3 shift;
};

// Where a screw motion has come to at path_time: a rotation by `revolutions` in a unit of time about the direction `axis`,
// by Rodrigues' formula, and a shift of which `slide` grows with time, `sine` and `versine` with these functions of the
// turn. The versine, 1 - cos, comes from half the angle, since the difference cancels.
Pose screw_pose(vec3 axis, float revolutions, vec3 slide, vec3 sine, vec3 versine)
{
    float turned = revolutions * path_time;
    turned -= round(turned);
    vec2 quarter = cos_sin(1.570796326794897 * turned);  // of a quarter of the angle, which is within π/4
    vec2 half_angle = vec2(1.0 - 2.0 * quarter.y * quarter.y, 2.0 * quarter.x * quarter.y);
    float s = 2.0 * half_angle.x * half_angle.y;
    float v = 2.0 * half_angle.y * half_angle.y;
    vec3 sa = s * axis;
    vec3 va = v * axis;
    mat3 turn = mat3(va * axis.x + vec3(1.0 - v, sa.z, -sa.y),
                     va * axis.y + vec3(-sa.z, 1.0 - v, sa.x),
                     va * axis.z + vec3(sa.y, -sa.x, 1.0 - v));
    return Pose(turn, path_time * slide + s * sine + v * versine);
}

#endif
