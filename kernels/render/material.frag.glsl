#version 430 core
// One material's texture, tileable: rgb √albedo, a height 0..1. Layers are the terrain's materials in their order,
// then the canopy of a forest seen from afar.
#include "textures.glsl"

// LAYER is set by textures.py: one program a layer.
in vec2 uv;
out vec4 texel;

struct Sample {
    vec3 albedo;
    float height;
};

float rise(float low, float high, float x) { return smoothstep(low, high, x); }

// Round stones of one size: 1 on top, 0 between them.
float stones(vec2 at, int cells, uint salt, out uint id)
{
    Cells c = worley(at, cells, 0.85, salt);
    id = c.id;
    float gap = c.second - c.first;
    return sqrt(clamp(gap * 1.9, 0.0, 1.0)) * (0.6 + 0.4 * unit(scramble(c.id ^ 77u)));
}

#if LAYER == 0 // grass
Sample material()
{
    vec2 warp = 0.012 * fbm4(uv, 9, 3, 0.6, 11u).xy;
    Cells tuft = worley(uv + warp, 26, 1.0, 13u);
    float blades = fbm(uv + 2.5 * warp, 90, 2, 0.7, 14u);
    float clump = fbm(uv, 5, 4, 0.55, 15u);
    float height = 0.48 + 0.22 * (0.62 - tuft.first) + 0.17 * blades + 0.14 * clump;
    float dry = rise(0.1, 0.9, 0.42 + 0.5 * fbm(uv, 7, 4, 0.6, 16u) + 0.25 * (unit(tuft.id) - 0.5));
    vec3 deep = vec3(0.024, 0.040, 0.010);
    vec3 leaf = mix(vec3(0.064, 0.106, 0.022), vec3(0.128, 0.136, 0.042), dry);
    vec3 tip = mix(vec3(0.112, 0.162, 0.036), vec3(0.215, 0.200, 0.078), dry);
    vec3 albedo = mix(deep, leaf, rise(0.2, 0.52, height));
    return Sample(mix(albedo, tip, rise(0.5, 0.85, height)), height);
}

#elif LAYER == 1 // soil
Sample material()
{
    float lumps = fbm(uv, 6, 6, 0.58, 21u);
    uint id;
    float grit = stones(uv, 34, 22u, id);
    float stone = unit(id) < 0.16 ? grit : 0.0;
    float height = 0.42 + 0.26 * lumps + 0.25 * stone;
    vec3 earth = mix(vec3(0.085, 0.058, 0.036), vec3(0.205, 0.148, 0.092), rise(-0.7, 0.8, lumps));
    vec3 pebble = mix(vec3(0.16, 0.14, 0.12), vec3(0.28, 0.25, 0.21), unit(scramble(id)));
    return Sample(mix(earth, pebble, rise(0.2, 0.5, stone)), height);
}

#elif LAYER == 2 // rock
Sample material()
{
    vec2 warp = 0.035 * fbm4(uv, 4, 4, 0.5, 31u).xy;
    float facets = ridged(uv + warp, 5, 6, 0.55, 33u);
    Cells crack = worley(uv + 1.6 * warp, 7, 0.9, 34u);
    Cells finer = worley(uv + 2.2 * warp, 19, 0.9, 35u);
    float open = rise(0.0, 0.14, crack.second - crack.first);
    float hair = rise(0.0, 0.16, finer.second - finer.first);
    float bed = fbm(vec2(uv.x, uv.y) + warp, 3, 5, 0.5, 36u);
    float step_ = unit(crack.id) * 0.35 + unit(finer.id) * 0.12;
    float height = clamp(0.02 + 0.70 * facets + step_ * 0.55 - 0.10 * (1.0 - open) - 0.05 * (1.0 - hair), 0.0, 1.0);
    vec3 grey = mix(vec3(0.115, 0.108, 0.102), vec3(0.315, 0.295, 0.268), rise(0.25, 0.85, height));
    vec3 warm = grey * mix(vec3(1.12, 1.0, 0.86), vec3(0.93, 0.99, 1.06), rise(-0.5, 0.5, bed));
    float lichen = rise(0.35, 0.75, fbm(uv, 12, 5, 0.65, 37u)) * rise(0.4, 0.6, height);
    warm = mix(warm, vec3(0.20, 0.205, 0.135), 0.35 * lichen);
    return Sample(warm * (0.80 + 0.20 * open) * (0.92 + 0.08 * hair), height);
}

#elif LAYER == 3 // scree
Sample material()
{
    uint big_id, mid_id, small_id;
    vec2 warp = 0.004 * fbm4(uv, 20, 2, 0.5, 41u).xy;
    float big = stones(uv + warp, 9, 43u, big_id);
    float mid = stones(uv + warp, 23, 44u, mid_id);
    float small = stones(uv, 60, 45u, small_id);
    bool is_big = unit(big_id) < 0.30 && big > 0.35;
    bool is_mid = unit(mid_id) < 0.6 && mid > 0.3;
    float height = is_big ? 0.5 + 0.5 * big : is_mid ? 0.25 + 0.5 * mid : 0.08 + 0.35 * small;
    uint id = is_big ? big_id : is_mid ? mid_id : small_id;
    float tone = unit(scramble(id ^ 5u));
    vec3 stone = mix(vec3(0.155, 0.145, 0.135), vec3(0.335, 0.315, 0.285), tone);
    stone *= mix(vec3(1.06, 1.0, 0.92), vec3(0.95, 1.0, 1.05), unit(scramble(id ^ 9u)));
    return Sample(stone * (0.42 + 0.58 * rise(0.05, 0.5, height)) * (1.0 + 0.15 * fbm(uv, 50, 2, 0.6, 46u)), height);
}

#elif LAYER == 4 // sand
Sample material()
{
    float warp = fbm(uv, 4, 2, 0.3, 51u);
    float phase = 18.0 * uv.x + 0.9 * warp;
    float crest = fract(phase + 0.05 * fbm(uv, 16, 2, 0.5, 52u));
    float ripple = crest < 0.68 ? crest / 0.68 : (1.0 - crest) / 0.32;
    ripple = ripple * ripple * (3.0 - 2.0 * ripple);
    float strength = 0.45 + 0.55 * rise(-0.5, 0.6, fbm(uv, 4, 3, 0.5, 53u));
    float grain = noise(uv, 200, 54u).x;
    float height = 0.42 + 0.30 * (ripple - 0.5) * strength + 0.07 * fbm(uv, 5, 4, 0.5, 55u) + 0.02 * grain;
    vec3 colour = mix(vec3(0.40, 0.262, 0.142), vec3(0.56, 0.39, 0.225), rise(0.2, 0.65, height));
    return Sample(colour * (1.0 + 0.06 * grain), height);
}

#elif LAYER == 5 // snow
Sample material()
{
    float drift = fbm(uv, 3, 5, 0.48, 61u);
    float wind = ridged(uv * vec2(1.0, 1.0), 6, 4, 0.5, 62u);
    float height = 0.35 + 0.2 * drift + 0.28 * wind;
    float sparkle = noise(uv, 160, 63u).x;
    return Sample(mix(vec3(0.76, 0.79, 0.84), vec3(0.90, 0.91, 0.92), rise(0.2, 0.7, height)) * (1.0 + 0.02 * sparkle),
        height);
}

#elif LAYER == 6 // river_bed
Sample material()
{
    uint big_id, small_id;
    float big = stones(uv, 15, 71u, big_id);
    float small = stones(uv, 44, 72u, small_id);
    bool is_big = unit(big_id) < 0.5 && big > 0.4;
    float height = is_big ? 0.3 + 0.6 * big : 0.1 + 0.4 * small;
    uint id = scramble((is_big ? big_id : small_id) ^ 3u);
    vec3 stone = mix(vec3(0.12, 0.108, 0.092), vec3(0.30, 0.275, 0.235), unit(id));
    return Sample(stone * (0.5 + 0.5 * rise(0.1, 0.5, height)), height);
}

#elif LAYER == 7 // forest_floor
Sample material()
{
    float litter = fbm(uv, 40, 3, 0.7, 81u);
    float moss = fbm(uv, 6, 5, 0.55, 82u);
    float height = 0.4 + 0.14 * litter + 0.2 * moss;
    vec3 brown = mix(vec3(0.034, 0.025, 0.014), vec3(0.098, 0.068, 0.036), rise(-0.7, 0.8, litter));
    vec3 green = mix(vec3(0.024, 0.034, 0.010), vec3(0.062, 0.080, 0.022), rise(-0.6, 0.7, litter));
    return Sample(mix(brown, green, rise(-0.25, 0.35, moss)), height);
}

#elif LAYER == 8 // canopy
Sample material()
{
    vec2 warp = 0.012 * fbm4(uv, 12, 3, 0.6, 91u).xy;
    Cells tree = worley(uv + warp, 15, 0.95, 93u);
    float size = 0.7 + 0.6 * unit(tree.id);
    float crown = clamp(1.0 - tree.first * tree.first * 1.5 / size, 0.0, 1.0);
    float leaves = fbm(uv, 60, 2, 0.6, 94u);
    float height = clamp(crown * (0.55 + 0.35 * unit(scramble(tree.id))) + 0.10 * leaves, 0.0, 1.0);
    float hue = unit(scramble(tree.id ^ 21u));
    vec3 leaf = mix(vec3(0.026, 0.046, 0.014), vec3(0.074, 0.092, 0.022), hue * hue);
    return Sample(leaf * (0.22 + 0.95 * rise(0.0, 0.75, height)), height);
}
#endif

void main()
{
    Sample s = material();
    texel = vec4(sqrt(clamp(s.albedo, 0.0, 1.0)), clamp(s.height, 0.0, 1.0));
}
