// The basis about an axis. In: input0.xyz = axis. Out: output0, 1, 2 = what local x, y and z become in world space.
#include "lib/sampling.glsl"

uniform sampler2D input0;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;

void main()
{
    vec3 axis = texelFetch(input0, ivec2(gl_FragCoord.xy), 0).xyz;
    output0 = vec4(to_world(vec3(1.0, 0.0, 0.0), axis), 0.0);
    output1 = vec4(to_world(vec3(0.0, 1.0, 0.0), axis), 0.0);
    output2 = vec4(to_world(vec3(0.0, 0.0, 1.0), axis), 0.0);
}
