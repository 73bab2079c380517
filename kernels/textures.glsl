// Tileable noise for procedural textures: all functions have period 1 in uv.

uint scramble(uint v)
{
    v ^= v >> 16; v *= 0x7feb352du;
    v ^= v >> 15; v *= 0x846ca68bu;
    return v ^ (v >> 16);
}

uint lattice_hash(ivec2 cell, int cells, uint salt)
{
    uvec2 c = uvec2(((cell % cells) + cells) % cells);
    return scramble(c.x + scramble(c.y + scramble(salt)));
}

float unit(uint hash) { return float(hash >> 8) * (1.0 / 16777216.0); }

// Gradient noise with `cells` lattice cells a side, about -1..1.
float gradient_noise(vec2 uv, int cells, uint salt)
{
    vec2 p = uv * float(cells);
    ivec2 cell = ivec2(floor(p));
    vec2 f = p - vec2(cell);
    vec2 s = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    float corner[4];
    for (int k = 0; k < 4; ++k) {
        ivec2 o = ivec2(k & 1, k >> 1);
        float angle = 6.2831853 * unit(lattice_hash(cell + o, cells, salt));
        corner[k] = dot(vec2(cos(angle), sin(angle)), f - vec2(o));
    }
    return 1.5 * mix(mix(corner[0], corner[1], s.x), mix(corner[2], corner[3], s.x), s.y);
}

float fbm(vec2 uv, int cells, int octaves, float gain, uint salt)
{
    float sum = 0.0, amplitude = 1.0;
    for (int i = 0; i < octaves; ++i) {
        sum += amplitude * gradient_noise(uv, cells << i, salt + uint(i));
        amplitude *= gain;
    }
    return sum;
}

float ridged(vec2 uv, int cells, int octaves, float gain, uint salt)
{
    float sum = 0.0, amplitude = 1.0, total = 0.0;
    for (int i = 0; i < octaves; ++i) {
        sum += amplitude * (1.0 - abs(gradient_noise(uv, cells << i, salt + uint(i))));
        total += amplitude;
        amplitude *= gain;
    }
    return sum / total;
}

struct Cells {
    float first;  // distance to the nearest point, in cells
    float second; // to the second nearest
    uint id;      // of the nearest
    vec2 away;    // from the nearest point, in cells
};

// One jittered point a lattice cell.
Cells worley(vec2 uv, int cells, float jitter, uint salt)
{
    vec2 p = uv * float(cells);
    ivec2 cell = ivec2(floor(p));
    Cells best = Cells(9.0, 9.0, 0u, vec2(0.0));
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i) {
            ivec2 c = cell + ivec2(i, j);
            uint id = lattice_hash(c, cells, salt);
            vec2 point = vec2(c) + 0.5 + jitter * (vec2(unit(id), unit(scramble(id))) - 0.5);
            float d = length(p - point);
            if (d < best.first) {
                best.second = best.first;
                best = Cells(d, best.second, id, p - point);
            } else best.second = min(best.second, d);
        }
    return best;
}
