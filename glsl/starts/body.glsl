// A path tracer for a ping-pong node of Gratin, which writes the head of the shader itself: the sampler `pingpong0`
// (what this node left in the pass before), the uniform `numpass` (0, 1, 2, ...) and the output `outBuffer0`.
// Check it with: @check@
@tracer@
// ------------------------------------------------------------------------------------------------------- Accumulation
// One sample a pass, added to the sum of those before; alpha counts them. Another node divides: rgb / a.
in vec2 texcoord;

void main()
{
    ivec2 size = textureSize(pingpong0, 0);
    ivec2 pixel = ivec2(texcoord * vec2(size));
    // In pass 0 `pingpong0` holds whatever was left there, so it is not read.
    vec4 past = numpass == 0 ? vec4(0.0) : texelFetch(pingpong0, pixel, 0);
    outBuffer0 = past + vec4(sample_pixel(uvec2(pixel), vec2(size), uint(numpass)), 1.0);
}
