// EXHIBIT, wrong on purpose. The handout's hash, here for the values on the lattice of value noise:
//
//     hash(n) = fract(sin(n)*43758.5453123)       right: an integer hash, as in lib/noise.glsl
//
// The lattice point is numbered n = x + 57 y + 113 z, as such noise usually does. The factor magnifies the last digits of
// the sine, which are each renderer's own: no two compute the same texture. Octaves differ by their scale only; `seed`
// is not used.
float hash(float n)
{
    return fract(sin(n)*43758.5453123);
}

void cell_values(vec3 corner, uint seed, out vec4 lower, out vec4 upper)
{
    float n = corner.x + 57.0 * corner.y + 113.0 * corner.z;
    lower = vec4(hash(n), hash(n + 1.0), hash(n + 57.0), hash(n + 58.0)) * 16777216.0;
    upper = vec4(hash(n + 113.0), hash(n + 114.0), hash(n + 170.0), hash(n + 171.0)) * 16777216.0;
}
