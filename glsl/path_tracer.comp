// The accumulation pass of path_tracer.frag as a compute shader: the same library, the same sums to the bit. (But for sums
// of 1e-37 and less: threads of llvmpipe that rasterise have zeros for denormal numbers, those that compute have not.) For
// devices that run it faster (harness/gpu/device.py); hosts and people have the fragment shader.
//
// `pingpong0`, `numpass` and the other uniforms are those of path_tracer.frag; `accumulated` is the texture that the pass
// fills, RGBA32F and as large as pingpong0. `band`: the first row that is filled, and the row behind the last. `stride`: how
// many groups of the band are leapt over from one to the next; it has no divisor in common with their number.
#extension GL_ARB_compute_shader : require
#include "scene.glsl"
#include "lib/path.glsl"

// Sixteen invocations are a square of 4 x 4 pixels, which wait for each other less than a row of 16 (1 to 4 %); four such
// squares are a group's 8 x 8.
layout(local_size_x = 16, local_size_y = 4) in;

uniform sampler2D pingpong0;
uniform int numpass;
uniform int samples_per_pass = 16;
uniform uint first_sample = 0u;   // index of this pass's first sample is first_sample + numpass * samples_per_pass
uniform uint replica = 0u;        // independent streams for independent estimates
uniform ivec2 band;
uniform uint stride;
layout(rgba32f) writeonly uniform image2D accumulated;

void main()
{
    ivec2 size = textureSize(pingpong0, 0);
    uvec2 lane = gl_LocalInvocationID.xy;
    uvec2 square = uvec2(lane.y & 1u, lane.y >> 1u);
    // llvmpipe gives each thread one run of groups. Side by side they would be a part of the image, dearer than another's:
    // on two cores 1.2 times the time went by.
    uvec2 groups = gl_NumWorkGroups.xy;
    uint group = (gl_WorkGroupID.y * groups.x + gl_WorkGroupID.x) * stride % (groups.x * groups.y);
    uvec2 corner = uvec2(group % groups.x, group / groups.x) * 8u + uvec2(0u, band.x);
    uvec2 pixel = corner + square * 4u + uvec2(lane.x & 3u, lane.x >> 2u);
    if (pixel.x >= uint(size.x) || pixel.y >= uint(band.y))
        return;
    uint first = first_sample + uint(numpass) * uint(samples_per_pass);
    vec4 sum = numpass > 0 ? texelFetch(pingpong0, ivec2(pixel), 0) : vec4(0.0);
    imageStore(accumulated, ivec2(pixel), trace_samples(sum, pixel, vec2(size), replica, first, samples_per_pass));
}
