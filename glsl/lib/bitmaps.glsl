// Mitsuba's textures `bitmap` and `checkerboard` at texture coordinates, which are those of the surface under `to_uv`.
#ifndef LIB_BITMAPS
#define LIB_BITMAPS

// The value of an image whose sampler filters and wraps as the scene file says. Without derivatives, which are not
// defined inside a loop; there are no mipmaps.
vec3 bitmap(sampler2D image, vec2 at)
{
    return textureLod(image, at, 0.0).rgb;
}

// Coordinates for a sampler that clamps to the edge, where the scene file says that the image is mirrored. The texel
// beyond the edge is the one on it, so the filter sees the same two.
vec2 mirrored(vec2 at)
{
    return abs(at - 2.0 * floor(0.5 * at + 0.5));
}

// Whether a checkerboard has its first colour: the fractions of u and v lie in the same half.
bool is_first_color(vec2 at)
{
    bvec2 upper = greaterThan(at - floor(at), vec2(0.5));
    return upper.x == upper.y;
}

#endif
