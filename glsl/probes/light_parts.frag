// The functions of lib/lights.glsl, lib/mis.glsl and the draws of lib/environment.glsl, each by itself. In: input0 = origin,
// height; input1 = two numbers in [0, 1), two positive ones; input2 = a number in [0, 1), distance, cosine, row; the first
// is also that part of a ball's squared radius. The light's place in uniforms: its middle (of a cylinder the foot), `edges`
// half its edges, which are at right angles, and `tube` the axes of a cylinder, whole length. Out: by `part`, direction and density where it is a draw.
//
// 0: output0 = towards; 1 = its least, pdf_area, ball_cap, pdf_ball; 2 = sample_ball; 3 = density of sample_sphere,
//    cylinder_arc, pdf_cube, pdf_cylinder outside; 4 = sample_around; 5 = sample_rectangle; 6 = sample_disk_light; 7 = faces_seen.
// 1: output0 = sample_cube; 1 = sample_cylinder outside; 2 = the same inside; 3 = pdf_cylinder inside, sample_cap,
//    sample_tent, mis_weight; 4 = place_in_run; density of sample_around outside.
#include "lib/lights.glsl"
#include "lib/mis.glsl"
#include "lib/environment.glsl"

uniform sampler2D input0;
uniform sampler2D input1;
uniform sampler2D input2;
uniform vec3 middle;
uniform mat3 edges, tube;
uniform float rows;
uniform int part;

layout(location = 0) out vec4 output0;
layout(location = 1) out vec4 output1;
layout(location = 2) out vec4 output2;
layout(location = 3) out vec4 output3;
layout(location = 4) out vec4 output4;
layout(location = 5) out vec4 output5;
layout(location = 6) out vec4 output6;
layout(location = 7) out vec4 output7;

void main()
{
    ivec2 row = ivec2(gl_FragCoord.xy);
    vec4 origin = texelFetch(input0, row, 0);
    vec4 numbers = texelFetch(input1, row, 0);
    vec4 more = texelFetch(input2, row, 0);
    vec3 o = origin.xyz, way = o - middle;
    vec2 u = numbers.xy;
    vec3 sizes = vec3(length(edges[0]), length(edges[1]), length(edges[2]));
    vec3 q = way * edges / (sizes * sizes);
    vec3 front = edges[2] / sizes.z;
    vec3 areas = 4.0 * sizes.yzx * sizes.zxy;
    float squared = 2.25 * more.x;
    float radius = length(tube[0]), half_area = radius * length(tube[2]);
    vec3 at = way * tube / vec3(radius * radius, radius * radius, dot(tube[2], tube[2]));
    if (part == 0) {
        LightSample found = towards(o, middle, origin.w, numbers.z);
        output0 = vec4(found.l, found.pdf);
        output1 = vec4(found.least, pdf_area(more.y, more.z, numbers.z), ball_cap(o, middle, squared),
                       pdf_ball(o, middle, squared));
        found = sample_ball(o, middle, squared, u);
        output2 = vec4(found.l, found.pdf);
        output3 = vec4(sample_sphere(o, middle, squared, u).pdf, cylinder_arc(numbers.w),
                       pdf_cube(q, areas, more.y, more.z), pdf_cylinder(at, half_area, 1.0, more.y, more.z));
        found = sample_around(u, true);
        output4 = vec4(found.l, found.pdf);
        found = sample_rectangle(o, middle, edges[0], edges[1], front, 4.0 * sizes.x * sizes.y, u);
        output5 = vec4(found.l, found.pdf);
        found = sample_disk_light(o, middle, edges[0], edges[1], front, PI * sizes.x * sizes.y, u);
        output6 = vec4(found.l, found.pdf);
        output7 = vec4(faces_seen(q, areas), 0.0);
    } else {
        LightSample found = sample_cube(o, q, middle, edges, areas, sizes, u);
        output0 = vec4(found.l, found.pdf);
        found = sample_cylinder(o, at, middle, tube, radius, half_area, 1.0, u);
        output1 = vec4(found.l, found.pdf);
        found = sample_cylinder(o, at, middle, tube, radius, half_area, -1.0, u);
        output2 = vec4(found.l, found.pdf);
        float angle = 3.14159265358979 / (rows - 1.0);
        output3 = vec4(pdf_cylinder(at, half_area, -1.0, more.y, more.z), sample_cap(u.x, angle, sin(0.5 * angle)),
                       sample_tent(more.w, rows, u.x, u.y), mis_weight(numbers.z, numbers.w));
        output4 = vec4(place_in_run(more.x, vec4(0.0, ENVIRONMENT_BINS, 3.0, 7.0)), sample_around(u, false).pdf, 0.0);
        output5 = output6 = output7 = vec4(0.0);
    }
}
