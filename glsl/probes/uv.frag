// Surface coordinates. In: input0 = point on a shape, shape id. Out: output0.xy = u, v.
#include "scene.glsl"

uniform sampler2D input0;

layout(location = 0) out vec4 output0;

void main()
{
    vec4 at = texelFetch(input0, ivec2(gl_FragCoord.xy), 0);
    output0 = vec4(surface_uv(int(at.w), at.xyz), 0.0, 0.0);
}
