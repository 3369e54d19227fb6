// The tab Image, with Buffer A as iChannel0: shows the mean of what was summed there, encoded for a display (sRGB).
void mainImage(out vec4 color, in vec2 at)
{
    vec4 sum = texelFetch(iChannel0, ivec2(at), 0);
    vec3 c = clamp(sum.rgb / sum.a, 0.0, 1.0);
    color = vec4(mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308))), 1.0);
}
