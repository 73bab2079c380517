// Tileable noise for procedural textures: all functions have period 1 in uv.
//
// Octaves come from one texture of band-limited noise, and loops run to a bound that the compiler cannot see:
// a driver that compiles for the CPU unrolls and inlines everything else, which took it seconds.

uniform sampler2D band_noise;  // four fields of BAND_CELLS cycles a side, mean 0, deviation 0.35
uniform int neighbours;        // 9
const int BAND_CELLS = 4;

uint scramble(uint v)
{
    v ^= v >> 16; v *= 0x7feb352du;
    v ^= v >> 15; v *= 0x846ca68bu;
    return v ^ (v >> 16);
}

uint lattice_hash(ivec2 cell, int cells, uint salt)
{
    uvec2 c = uvec2(((cell % cells) + cells) % cells);
    return scramble(c.x + scramble(c.y + salt * 0x9e3779b9u));
}

float unit(uint hash) { return float(hash >> 8) * (1.0 / 16777216.0); }

// Noise of about `cells` cycles a side, rounded to a power of two times BAND_CELLS or less, about -1..1.
vec4 noise(vec2 uv, int cells, uint salt)
{
    float scale = float(max(1, (cells + BAND_CELLS / 2) / BAND_CELLS));
    vec2 shift = vec2(unit(scramble(salt)), unit(scramble(salt + 1000u)));
    return textureLod(band_noise, uv * scale + shift, 0.0);
}

vec4 fbm4(vec2 uv, int cells, int octaves, float gain, uint salt)
{
    vec4 sum = vec4(0.0);
    float amplitude = 1.0;
    for (int i = 0; i < octaves; ++i) {
        sum += amplitude * noise(uv, cells << i, salt + uint(i));
        amplitude *= gain;
    }
    return sum;
}

float fbm(vec2 uv, int cells, int octaves, float gain, uint salt)
{
    return fbm4(uv, cells, octaves, gain, salt).x;
}

float ridged(vec2 uv, int cells, int octaves, float gain, uint salt)
{
    float sum = 0.0, amplitude = 1.0, total = 0.0;
    for (int i = 0; i < octaves; ++i) {
        sum += amplitude * (1.0 - abs(noise(uv, cells << i, salt + uint(i)).y));
        total += amplitude;
        amplitude *= gain;
    }
    return sum / total;
}

struct Cells {
    float first;  // distance to the nearest point, in cells
    float second; // to the second nearest
    uint id;      // of the nearest
};

// One jittered point a lattice cell.
Cells worley(vec2 uv, int cells, float jitter, uint salt)
{
    vec2 p = uv * float(cells);
    ivec2 cell = ivec2(floor(p));
    Cells best = Cells(9.0, 9.0, 0u);
    for (int k = 0; k < neighbours; ++k) {
        ivec2 c = cell + ivec2(k % 3 - 1, k / 3 - 1);
        uint id = lattice_hash(c, cells, salt);
        vec2 point = vec2(c) + 0.5 + jitter * (vec2(id & 0xffffu, id >> 16) / 65535.0 - 0.5);
        float d = length(p - point);
        best.second = min(best.second, max(d, best.first));
        best.id = d < best.first ? id : best.id;
        best.first = min(d, best.first);
    }
    return best;
}
