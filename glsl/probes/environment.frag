// Light from infinity. In: input0 = unit direction towards it. Out: output0.rgb = its radiance.
#include "scene.glsl"

uniform sampler2D input0;

layout(location = 0) out vec4 output0;

void main()
{
    output0 = vec4(environment(texelFetch(input0, ivec2(gl_FragCoord.xy), 0).xyz), 0.0);
}
