// EXHIBIT, weak on purpose. The handout's random numbers:
//
//     seed = (numpass*0.9610356 + 1024*texcoord.x + texcoord.y)*1.51269341231
//     rand() = fract(sin(seed++)*43758.5453123)
//
//     right: an integer hash of pixel, pass and replica, as in lib/random.glsl
//
// The seed is a float32. It has few distinct values, fewer the larger it is: its spacing is 1/64 at pass 100,000, while
// from one row of a 1024² image to the next it changes by 0.0015. IMAGE_SIZE is the image's size in pixels. A pass draws
// one sample; there is no replica in it.
float seed;
vec2 course_texcoord;

uvec2 pixel_stream(uvec2 pixel, uint replica)
{
    course_texcoord = (vec2(pixel) + 0.5) / IMAGE_SIZE;
    return uvec2(0u);
}

void seed_sample(uvec2 stream, uint index)
{
    float numpass = float(index);
    vec2 texcoord = course_texcoord;
    seed = (numpass*0.9610356 + 1024*texcoord.x + texcoord.y)*1.51269341231;
}

float rand()
{
    return fract(sin(seed++)*43758.5453123);
}
