// Rigid motion of shapes. Every shape is met, textured and lit where it rests, which is where it is at time 0; rays are
// carried there, and normals back. The generated scene defines set_time, to_rest and from_rest.
#ifndef LIB_MOTION
#define LIB_MOTION

float path_time;  // the moment at which the current path sees the scene

// Carries a point p of a shape at rest to turn * p + shift. Its inverse takes p to (p - shift) * turn.
struct Pose {
    mat3 turn;
    vec3 shift;
};

// Where a screw motion has come to at path_time: a rotation by `angle` in a unit of time about the direction `axis`, by
// Rodrigues' formula, and a shift of which `slide` grows with time, `sine` and `versine` with these functions of the
// turn. Half the turn keeps the versine, 1 - cos, from cancelling.
Pose screw_pose(vec3 axis, float angle, vec3 slide, vec3 sine, vec3 versine)
{
    float half_turn = 0.5 * angle * path_time;
    float h = sin(half_turn);
    float s = 2.0 * h * cos(half_turn);
    float v = 2.0 * h * h;
    vec3 sa = s * axis;
    vec3 va = v * axis;
    mat3 turn = mat3(va * axis.x + vec3(1.0 - v, sa.z, -sa.y),
                     va * axis.y + vec3(-sa.z, 1.0 - v, sa.x),
                     va * axis.z + vec3(sa.y, -sa.x, 1.0 - v));
    return Pose(turn, path_time * slide + s * sine + v * versine);
}

#endif
