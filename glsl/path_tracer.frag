// The path tracer's accumulation pass, in the course's ping-pong contract.
//
// `pingpong0` holds the previous pass's result: rgb = sum of radiance, alpha = number of samples. `numpass` counts
// passes from 0, when pingpong0 may hold anything and is not read. `texcoord` runs over [0,1]², (0,0) at the bottom
// left. display.frag divides and shows. The defaults of the other uniforms let any such host run this file as it is,
// once it has bound a scene's images as the comments beside their samplers say.
#include "scene.glsl"
#include "lib/path.glsl"

uniform sampler2D pingpong0;
uniform int numpass;
uniform int samples_per_pass = 16;
uniform uint first_sample = 0u;   // index of this pass's first sample is first_sample + numpass * samples_per_pass
uniform uint replica = 0u;        // independent streams for independent estimates

in vec2 texcoord;
layout(location = 0) out vec4 accumulated;

void main()
{
    ivec2 size = textureSize(pingpong0, 0);
    uvec2 pixel = uvec2(texcoord * vec2(size));
    uint first = first_sample + uint(numpass) * uint(samples_per_pass);
    vec4 sum = numpass > 0 ? texelFetch(pingpong0, ivec2(pixel), 0) : vec4(0.0);
    accumulated = trace_samples(sum, pixel, vec2(size), replica, first, samples_per_pass);
}
