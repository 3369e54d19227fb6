// The display pass: divides the accumulated sum by its number of samples, applies the exposure (in stops) and
// encodes sRGB (IEC 61966-2-1).
uniform sampler2D pingpong0;
uniform float exposure = 0.0;

in vec2 texcoord;
layout(location = 0) out vec4 displayed;

vec3 encode_srgb(vec3 linear)
{
    vec3 c = clamp(linear, 0.0, 1.0);
    return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308)));
}

void main()
{
    vec4 sum = texelFetch(pingpong0, ivec2(texcoord * vec2(textureSize(pingpong0, 0))), 0);
    vec3 mean = sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0);
    displayed = vec4(encode_srgb(mean * exp2(exposure)), 1.0);
}
