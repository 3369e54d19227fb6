// A direction to one light, drawn by lib/lights.glsl, and its density. In: input0 = origin; input1 = the two numbers of the
// direction. `SHAPE` is one of the five below, the light's place in uniforms. Out: output0 = direction, density; output1 =
// the density which lib/lights.glsl gives to a ray that meets the light at distance `input1.z`, where it makes the cosine
// `input1.w`; 0 where there is no such function.
#include "lib/lights.glsl"

#define BALL 0
#define RECTANGLE 1
#define DISK 2
#define CUBE 3
#define CYLINDER 4

uniform sampler2D input0;
uniform sampler2D input1;
uniform vec3 middle;  // of the light; of a cylinder its foot
uniform vec3 edge_x, edge_y, edge_z;  // half its edges; of a cylinder its radii, and its whole length
uniform float side;   // 1 where it shines outwards, -1 inwards

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec3 o = texelFetch(input0, row, 0).xyz;
    vec4 u = texelFetch(input1, row, 0);
    vec3 sizes = vec3(length(edge_x), length(edge_y), length(edge_z));
    vec3 q = vec3(dot(o - middle, edge_x), dot(o - middle, edge_y), dot(o - middle, edge_z)) / (sizes * sizes);
    mat3 axes = mat3(edge_x, edge_y, edge_z);
    float met = 0.0;
#if SHAPE == BALL
    LightSample found;
    if (side > 0.0)
        found = sample_sphere(o, middle, sizes.x * sizes.x, u.xy);
    else
        found = sample_around(u.xy, length(q) < 1.0);
    met = side > 0.0 ? pdf_ball(o, middle, sizes.x * sizes.x) : INV_FOUR_PI;
#elif SHAPE == RECTANGLE
    float area = 4.0 * sizes.x * sizes.y;
    LightSample found = sample_rectangle(o, middle, edge_x, edge_y, edge_z / sizes.z, area, u.xy);
    met = pdf_area(u.z, u.w, area);
#elif SHAPE == DISK
    float area = PI * sizes.x * sizes.y;
    LightSample found = sample_disk_light(o, middle, edge_x, edge_y, edge_z / sizes.z, area, u.xy);
    met = pdf_area(u.z, u.w, area);
#elif SHAPE == CUBE
    vec3 areas = 4.0 * sizes.yzx * sizes.zxy;
    LightSample found = sample_cube(o, q, middle, axes, areas, sizes, u.xy);
    met = pdf_cube(q, areas, u.z, u.w);
#else
    float half_area = sizes.x * sizes.z;
    LightSample found = sample_cylinder(o, q, middle, axes, sizes.x, half_area, side, u.xy);
    met = pdf_cylinder(q, half_area, side, u.z, u.w);
#endif
    output0 = vec4(found.l, found.pdf);
    output1 = vec4(met, 0.0, 0.0, 0.0);
}
