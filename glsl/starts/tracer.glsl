// ---------------------------------------------------------------------------------------------------------- The scene
// A glossy ball on a matt floor under an even sky. Lengths are in the scene's units, light is linear RGB radiance.
const vec3 SKY = vec3(0.8, 0.9, 1.0);        // what shines from every direction in which nothing is met
const vec3 BALL = vec3(0.0, 1.0, 0.0);       // the ball's centre
const float BALL_RADIUS = 1.0;
const float FLOOR_HALF = 6.0;                // the floor is the square |x|, |z| <= 6 at height y = 0
const vec3 EYE = vec3(0.0, 2.0, 6.0);        // the camera looks from here ...
const vec3 TARGET = vec3(0.0, 0.8, 0.0);     // ... to there
const float FOV = 40.0;                      // degrees across the width of the image
const int BOUNCES = 5;                       // a path is scattered so often at most
const float PI = 3.14159265358979;
const float OFFSET = 1e-4;                   // lifts a ray off the surface that it leaves, or it would meet it again

struct Material { vec3 kd; vec3 ks; float alpha; };  // diffuse albedo, specular coefficient, exponent
struct Hit { float t; vec3 normal; Material material; };

// ----------------------------------------------------------------------------------------------------- Random numbers
// PCG, an integer hash (Jarzynski and Olano 2020). Its state is a global: each draw goes on from the one before.
uint state;

uint hash(uint v)
{
    v = v * 747796405u + 2891336453u;
    v = ((v >> ((v >> 28u) + 4u)) ^ v) * 277803737u;
    return (v >> 22u) ^ v;
}

// Uniform in [0, 1): 24 bits, as many as a float holds, so that 1 itself never comes.
float rand()
{
    state = state * 747796405u + 2891336453u;
    return float(hash(state) >> 8u) / 16777216.0;
}

// ------------------------------------------------------------------------------------------------------- Intersection
// The nearest thing that the ray o + t d meets. False where it escapes to the sky.
bool intersect(vec3 o, vec3 d, out Hit hit)
{
    hit.t = 1e30;
    // The ball: |o + t d - BALL|^2 = BALL_RADIUS^2, a quadratic equation in t; d has length 1.
    vec3 from_centre = o - BALL;
    float b = dot(from_centre, d);
    float discriminant = b * b - dot(from_centre, from_centre) + BALL_RADIUS * BALL_RADIUS;
    float t_ball = -b - sqrt(max(discriminant, 0.0));  // rays start outside, so the nearer root is the entry
    if (discriminant > 0.0 && t_ball > 0.0) {
        hit.t = t_ball;
        hit.normal = normalize(from_centre + t_ball * d);
        hit.material = Material(vec3(0.5, 0.2, 0.1), vec3(0.3), 20.0);
    }
    // The floor: o.y + t d.y = 0, if that lies within the square.
    float t_floor = -o.y / d.y;
    vec3 p = o + t_floor * d;
    if (d.y < 0.0 && t_floor > 0.0 && t_floor < hit.t && max(abs(p.x), abs(p.z)) <= FLOOR_HALF) {
        hit.t = t_floor;
        hit.normal = vec3(0.0, 1.0, 0.0);
        hit.material = Material(vec3(0.5, 0.48, 0.45), vec3(0.0), 1.0);
    }
    return hit.t < 1e30;
}

// --------------------------------------------------------------------------------------------------------------- BRDF
// f(l, v) = kd/pi + ks (alpha + 1)/(2 pi) max(dot(r, v), 0)^alpha, r the mirror image of l. Directions point away from
// the surface. The cosine dot(n, l) is not in it.
vec3 brdf(Material m, vec3 n, vec3 l, vec3 v)
{
    vec3 r = 2.0 * dot(n, l) * n - l;
    return m.kd / PI + m.ks * (m.alpha + 1.0) / (2.0 * PI) * pow(max(dot(r, v), 0.0), m.alpha);
}

// ----------------------------------------------------------------------------------------------------------- Sampling
// A direction about n with the density cos(theta) / pi per steradian: cos^2 is uniform. To draw the glossy lobe as
// well, at random, and to divide by the combined density, is the next step: the same image, with less noise.
vec3 sample_direction(vec3 n)
{
    float cos_theta = sqrt(1.0 - rand());
    float sin_theta = sqrt(max(1.0 - cos_theta * cos_theta, 0.0));
    float phi = 2.0 * PI * rand();
    // Two axes across n, from any vector that is far from parallel to it.
    vec3 tangent = normalize(cross(abs(n.x) > 0.5 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0), n));
    vec3 bitangent = cross(n, tangent);
    return sin_theta * (cos(phi) * tangent + sin(phi) * bitangent) + cos_theta * n;
}

// --------------------------------------------------------------------------------------------------------- The path
// L = mean of f(l, v) Li(l) dot(n, l) / pdf(l), followed from bounce to bounce: `throughput` is the product so far.
vec3 trace(vec3 o, vec3 d)
{
    vec3 throughput = vec3(1.0);
    for (int bounce = 0; bounce <= BOUNCES; ++bounce) {
        Hit hit;
        if (!intersect(o, d, hit))
            return throughput * SKY;
        vec3 l = sample_direction(hit.normal);
        float cos_l = dot(hit.normal, l);
        float pdf = cos_l / PI;
        throughput *= brdf(hit.material, hit.normal, l, -d) * cos_l / pdf;
        o = o + hit.t * d + OFFSET * hit.normal;
        d = l;
    }
    return vec3(0.0);  // still between ball and floor after all bounces: its light is given up
}

// --------------------------------------------------------------------------------------------------------- The camera
// One sample of one pixel, (0, 0) the lower left one. `number` tells samples of a pixel apart: equal numbers give equal
// samples, so it must be another in each frame.
vec3 sample_pixel(uvec2 pixel, vec2 size, uint number)
{
    state = hash(pixel.x + hash(pixel.y + hash(number)));
    vec2 at = 2.0 * (vec2(pixel) + vec2(rand(), rand())) / size - 1.0;  // a random point of the pixel, in [-1, 1]^2
    vec3 forward = normalize(TARGET - EYE);
    vec3 right = normalize(cross(forward, vec3(0.0, 1.0, 0.0)));
    vec3 up = cross(right, forward);
    vec2 across = at * tan(radians(FOV) / 2.0) * vec2(1.0, size.y / size.x);
    return trace(EYE, normalize(forward + across.x * right + across.y * up));
}

