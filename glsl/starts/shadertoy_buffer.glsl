// A path tracer for Shadertoy: this is its tab Buffer A, with Buffer A itself as iChannel0 (filter: nearest).
// Check it with: @check@
@tracer@
// ------------------------------------------------------------------------------------------------------- Accumulation
// One sample a frame, added to the sum of those before; alpha counts them. The tab Image divides.
void mainImage(out vec4 color, in vec2 at)
{
    vec4 past = iFrame == 0 ? vec4(0.0) : texelFetch(iChannel0, ivec2(at), 0);
    color = past + vec4(sample_pixel(uvec2(at), iResolution.xy, uint(iFrame)), 1.0);
}
