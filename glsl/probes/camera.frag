// The camera ray through a point of the film. In: input0 = film point, (0,0) at the bottom left, and what picks the point
// of the lens where there is one. Out: output0 = origin, reach; output1 = direction.
#include "scene.glsl"
#include "lib/camera.glsl"

uniform sampler2D input0;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;

void main()
{
    vec3 o, d;
    float reach;
    vec4 numbers = texelFetch(input0, ivec2(gl_FragCoord.xy), 0);
#if HAS_LENS
    lens_ray(numbers.xy, numbers.zw, o, d, reach);
#else
    camera_ray(numbers.xy, o, d, reach);
#endif
    output0 = vec4(o, reach);
    output1 = vec4(d, 0.0);
}
