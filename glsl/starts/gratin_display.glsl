// Shows what the path tracer's node has summed: its mean, encoded for a display (sRGB).
in vec2 texcoord;

void main()
{
    vec4 sum = texture(inBuffer0, texcoord);
    vec3 c = clamp(sum.rgb / sum.a, 0.0, 1.0);
    outBuffer0 = vec4(mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308))), 1.0);
}
