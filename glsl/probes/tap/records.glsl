// Where the taps write: the storage buffer, and the records in it by number, as harness/gpu/tap.py names them.
layout(std430, binding = 0) buffer Taps { vec4 taps[]; };
uniform int tap_sample;      // of the pass, from 0
uniform int tap_vertices;    // for which there is room
uniform float tap_moment;    // in [0, 1): all paths then see that moment of the shutter's interval; as drawn if negative
uniform int tap_shape;       // of to_rest and from_rest, see TAP_POSE
uniform vec3 tap_point;

// Of a vertex.
#define TAP_ORIGIN 0       // of the ray, distance to the hit
#define TAP_RAY 1          // its direction, shape (-1 where it escapes)
#define TAP_NORMAL 2       // what surface_normal returned; which functions were called: sum of the TAP_CALLED_… below
#define TAP_PLACE 3        // what surface_normal was given; the ray's reach
#define TAP_FACING 4       // the normal that sample_phong was given; how far it, or the viewer's direction, is from those met
#define TAP_DIRECTION 5    // what sample_phong drew; numbers that it took
#define TAP_WEIGHT 6       // what it returned; numbers that the path took before
#define TAP_DIFFUSE 7      // kd, alpha
#define TAP_GLOSSY 8       // ks, p_glossy
#define TAP_LIGHT 9        // what emission or environment returned
#define TAP_SURFACE 10     // u, v; how far places and shapes handed on are from those met; the same of environment's direction
#define TAP_STATES 11      // the generator's before and after sample_phong
#define TAP_LOBE 12        // axis that a sampler of lib/sampling.glsl was given, exponent
#define TAP_NUMBERS 13     // its two numbers; pdf_lobe and pdf_cosine of the direction
#define TAP_BRDF 14        // eval_phong of the direction; its cosine to the mirror direction
#define TAP_TANGENT 15     // what to_world makes of local x about the axis; which sampler: 1 uniform, 2 cosine, 3 lobe
#define TAP_BITANGENT 16   // the same of local y
#define TAP_ABOUT 17       // direction_about of that axis, cosine 0.6 and the second number
#define TAP_TURNED 18      // what from_rest returned
#define TAP_LIFTED 19      // offset_origin of the place that was met and the normal that sample_phong was given; 1 if asked
#define TAP_MET 20         // the place that was met
#define TAP_DRAWN 21       // what the sampler returned; 1 if one was called
#define TAP_TAKEN 22       // the first four numbers that sample_phong took
#define TAP_VERTEX_RECORDS 23
// Of a path.
#define TAP_FILM 0         // film point, numbers of the lens
#define TAP_STREAM 1       // what pixel_stream returned
#define TAP_SEED 2         // index that seed_sample was given; the state after it
#define TAP_GENERATOR 3    // of all numbers of the pass: largest deviation from the published generator, wrong states, count, max
#define TAP_FIRST 4        // the path's first four numbers
#define TAP_TIME 5         // what set_time was given, path_time after it, how often it was called, 0
#define TAP_EYE 6          // the camera ray's origin and reach
#define TAP_GAZE 7         // its direction; vertices of the path
#define TAP_GIVEN 8        // the sum that trace_samples was given
#define TAP_RETURNED 9     // the sum that it returned
#define TAP_ASKED 10       // index of its first sample, replica, samples
#define TAP_PIXEL 11       // pixel and size that it was given
#define TAP_FINITE 12      // is_finite of a number that is not one, of infinity, of 1e30; 1 if asked
#define TAP_POSE 13        // to_rest(tap_shape, tap_point)
#define TAP_POSE_NORMAL 14 // from_rest(tap_shape, tap_point)
#define TAP_PATH_RECORDS 15

#define TAP_CALLED_INTERSECT 1.0
#define TAP_CALLED_NORMAL 2.0
#define TAP_CALLED_ENVIRONMENT 4.0
#define TAP_CALLED_EMISSION 8.0
#define TAP_CALLED_SCATTER 16.0

int tap_base;                // where the pixel's records begin
int tap_sample_now = -1, tap_vertex_now = -1;
int tap_drawn = 0;           // numbers of the path so far
int tap_scattering = -1;     // of them, those taken when sample_phong was called; -1 outside it
vec4 tap_generator = vec4(0.0);
float tap_calls = 0.0;       // of functions at the vertex
float tap_times = 0.0;       // calls of set_time by the path
// How far what the loop hands on at the vertex is from what it was told: places, and the normal and viewer's direction.
float tap_astray, tap_askew;
// What the loop was last told, which it hands on to the next function.
vec3 tap_o, tap_d, tap_p, tap_rest, tap_n;
int tap_id;
vec2 tap_uv;
bool tap_shifts = false;     // from_rest is called next for the way to a projected hit, not for the normal

vec2 tap_halves(uint word)
{
    return vec2(float(word >> 16u), float(word & 0xffffu));
}

bool tap_path()
{
    return tap_sample_now == tap_sample;
}

bool tap_here()
{
    return tap_path() && tap_vertex_now < tap_vertices;
}

#define tap_of_path(record) taps[tap_base + record]
#define tap_at_vertex(record) taps[tap_base + TAP_PATH_RECORDS + tap_vertex_now * TAP_VERTEX_RECORDS + record]

float tap_apart(vec3 a, vec3 b)
{
    vec3 c = abs(a - b);
    return max(max(c.x, c.y), c.z);
}
