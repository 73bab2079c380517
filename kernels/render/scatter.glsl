// Places strewn by hashed cells, as render/scatter.py asks for them. Pure. Oracle: tests/render/test_scatter.py.

const float BAND = 0.3;           // as in render/scatter.py
const uint FIRST_STEP = 3242174889u;  // 2³² over the plastic number …
const uint SECOND_STEP = 2447445414u; // … and over its square: the sequence R2 (Roberts 2018)
const float JITTER = 0.52;            // of the distance between neighbours, so that no lattice shows

// Wellons' lowbias32.
uint scrambled(uint h)
{
    h = (h ^ (h >> 16)) * 0x7feb352du;
    h = (h ^ (h >> 15)) * 0x846ca68bu;
    return h ^ (h >> 16);
}

// 0..1, from the upper 24 bits.
float draw_of(uint h) { return float(h >> 8) / 16777216.0; }

// The hash of a place, by its cell's hash and its rank.
uint place_hash(uint seed, uint rank) { return scrambled(seed ^ (rank * 0x9e3779b9u + 0x7f4a7c15u)); }

// Where a place lies in its cell, 0..1: the sequence, turned round the cell by its hash, and jittered less the denser
// its beginning is.
vec2 strewn(uint seed, uint rank)
{
    uint h = place_hash(seed, rank);
    uint across = scrambled(seed) + (rank + 1u) * FIRST_STEP;
    uint along = scrambled(seed + 1u) + (rank + 1u) * SECOND_STEP;
    vec2 shaken = vec2(draw_of(scrambled(h + 1u)), draw_of(scrambled(h + 2u))) - 0.5;
    return fract(vec2(draw_of(across), draw_of(along)) + shaken * (JITTER / sqrt(float(rank) + 1.0)));
}

// Share of a cell's places that is shown at a distance: all up to `full`, then as the distance's inverse.
float shown_share(float away, float full) { return full / max(away, full); }

// How far a place of a rank (of so many a cell has) has come up at a distance, 0..1. As many come up per metre as fit
// to `shown_share`; near the reach all go.
float presence(uint rank, float room, float away, float full, float reach)
{
    float share = shown_share(away, full);
    float order = (float(rank) + 0.5) / room;
    float up = clamp((share * (1.0 + BAND) - order) / (BAND * share), 0.0, 1.0);
    return up * clamp((reach - away) / (0.35 * reach), 0.0, 1.0);
}
