// Hex tiling: hexagons of a texture with random shift and rotation, which hide its repetition (Mikkelsen 2022,
// "Practical Real-Time Hex-Tiling", JCGT 11(3); grid of Heitz & Neyret 2018, §4.1). The lattice is skewed by 1/2
// instead of 1/√3 with steps of half a texture, so that it repeats after HEX_PERIOD textures; the host passes texture
// coordinates of the eye modulo that.

const float HEX_RATE = 2.0;        // lattice steps per texture
const int HEX_PERIOD = 64;         // textures, and lattice points, after which the tiling repeats
const float HEX_SHARPNESS = 7.0;   // exponent of the weights: little blending preserves contrast
const float HEX_MIN_WEIGHT = 0.02; // weight below which a hexagon is skipped

// The hexagons at a position by decreasing weight (sum 1); only the first `count` matter.
struct Hexagons {
    ivec2 first, second, third;
    vec3 weight;
    int count;
};

// Barycentric coordinates in the triangle of lattice points around a position (texture widths).
Hexagons hexagons(vec2 uv)
{
    vec2 skewed = HEX_RATE * vec2(uv.x - 0.5 * uv.y, uv.y);
    vec2 corner = floor(skewed);
    vec2 t = skewed - corner;
    float upper = step(1.0, t.x + t.y);
    float side = 2.0 * upper - 1.0;
    vec3 weight = vec3(side * (t.x + t.y - 1.0), upper - side * t.y, upper - side * t.x);
    ivec2 base = ivec2(corner);
    int u = int(upper);
    ivec2 a = base + u, b = base + ivec2(u, 1 - u), c = base + ivec2(1 - u, u);
    weight = pow(max(weight, 0.0), vec3(HEX_SHARPNESS));
    weight /= weight.x + weight.y + weight.z;
    Hexagons h = Hexagons(a, b, c, weight, 3);
    if (h.weight.y > h.weight.x) { h.weight = h.weight.yxz; h.first = b; h.second = a; }
    if (h.weight.z > h.weight.x) { h.weight = h.weight.zyx; ivec2 k = h.first; h.first = h.third; h.third = k; }
    if (h.weight.z > h.weight.y) { h.weight = h.weight.xzy; ivec2 k = h.second; h.second = h.third; h.third = k; }
    h.count = h.weight.z > HEX_MIN_WEIGHT ? 3 : h.weight.y > HEX_MIN_WEIGHT ? 2 : 1;
    return h;
}

// Centre of a hexagon, texture widths.
vec2 hex_centre(ivec2 id) { return vec2(float(id.x) + 0.5 * float(id.y), float(id.y)) / HEX_RATE; }

// Hash of a hexagon: xy 0..1 for its shift, z -1..1 for its rotation.
vec3 hex_hash(ivec2 id)
{
    uint h = uint(id.x & (HEX_PERIOD - 1)) | uint(id.y & (HEX_PERIOD - 1)) << 8;
    h *= 0x9E3779B9u;
    h ^= h >> 16; h *= 0x7FEB352Du;
    h ^= h >> 15; h *= 0x846CA68Bu;
    h ^= h >> 16;
    return vec3(vec2(h & 0x7FFu, (h >> 11) & 0x7FFu) / 2048.0, float(h >> 22) / 512.0 - 1.0);
}
