// EXHIBIT, wrong on purpose. The handout's tangent of the frame about w:
//
//     normalize(cross(w.yzx, w))       right: Duff et al. 2017, JCGT 6(1), as in lib/sampling.glsl
//
// w.yzx is w turned about (1,1,1), so the two are parallel where w is (1,1,1) or its opposite: the cross product is
// zero, and normalize(vec3(0.0)) is NaN. Nearby it is a small difference of nearly equal numbers, so the tangent keeps
// only a few correct digits.
vec3 to_world(vec3 local, vec3 axis)
{
    vec3 w = axis;
    vec3 u = normalize(cross(w.yzx, w));
    vec3 v = cross(w, u);
    return local.x * u + local.y * v + local.z * w;
}
