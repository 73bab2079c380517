// The leaves of a spray, cut out of a sheet: side twigs in two ranks, each with two ranks of leaves or a fringe of
// needles. Pure; the same in NumPy float64: look/tree_levels.py.

const float TWIG = 0.025;        // half the twig's width, of the sheet's
const float SIDE_TWIG = 0.06;    // the same of side twigs, of the distance between them
const float LEAN = 0.6;          // of leaves towards the side twig's tip, in their widths
const float COARSE = 1.1;        // leaves a pixel above which clusters are drawn instead
const float LIVELY = 0.55;       // variation of leaves' brightness …
const vec3 AGED = vec3(0.30, 0.06, -0.25); // … and colour: the young are yellower
// Leaf pairs and needles: side twigs a rank; leaves along half a sheet; inclination of side twigs; share of leaves grown.
const vec4 PAIRS = vec4(5.0, 6.0, 0.26, 0.98), FRINGE = vec4(14.0, 18.0, 0.24, 1.0);

// Two random numbers 0..1 of a leaf.
vec2 leaf_random(uint leaf)
{
    uint h = leaf * 0x9e3779b9u;
    h ^= h >> 15; h *= 0x85ebca6bu; h ^= h >> 13;
    return vec2(h & 0xffffu, h >> 16) / 65536.0;
}

// x: positive inside leaves; y: random number of the leaf.
//   at:    across the sheet -1..1 and along it 0..1
//   kind:  0 and 0.125 solid (bark, banded bark), 0.5 leaf pairs, 1 needles
//   spray: 0..255, varies its leaves
//   wide:  1 for leaves, 2 for clusters of them that cover the same
vec2 leaf_mask(vec2 at, float kind, uint spray, float wide)
{
    if (kind < 0.25) return vec2(1.0, 0.5);
    bool needles = kind > 0.75;
    vec4 form = needles ? FRINGE : PAIRS;
    float away = abs(at.x), side = at.x < 0.0 ? 1.0 : 0.0;
    float inclined = at.y - form.z * away;
    float row = inclined * form.x + 0.5 * side + float(spray) / 256.0, of_row = floor(row);
    float across = fract(row) - 0.5, out_ = 2.0 * abs(across), half_ = across < 0.0 ? 1.0 : 0.0;
    if (wide > 1.0 && !needles) half_ = 0.0, out_ = 0.5 + across;
    float along = clamp(inclined + 0.1, 0.0, 1.0);
    float grown = fract(of_row * 0.618034 + 0.37 * side + float(spray) * 0.0911);
    float reach = min(1.8 * sqrt(1.0 - along * along), 1.15) * min(5.0 * along + 0.1, 1.0) * (0.35 + 0.65 * grown);
    float cell = away * form.y / wide - (needles ? 2.0 : wide > 1.0 ? 0.0 : LEAN) * out_ + 0.5 * half_ + 4.0;
    float of_cell = floor(cell);
    vec2 random = leaf_random(uint(of_cell + 64.0 * (of_row + 32.0) + 4096.0 * (side + 2.0 * half_)) + (spray << 16));
    float full = needles ? (wide > 1.0 ? 2.0 * (0.67 - out_) : 0.5 - 0.32 * out_)
                         : (wide > 1.0 ? 1.0 : 0.84 + 0.18 * random.x) * sqrt(max(out_ * (1.0 - out_), 0.0));
    float leaf = (away < reach && random.y < form.w) ? full - (needles && wide > 1.0 ? 0.0 : abs(cell - of_cell - 0.5)) : -1.0;
    float twig = max(TWIG - away, away < reach ? SIDE_TWIG - abs(across) : -1.0);
    return vec2(max(leaf, twig), random.x);
}

// Colour of a leaf by its random number, relative to its spray's.
vec3 leaf_tone(float random, vec2 at)
{
    return (1.0 + LIVELY * (random - 0.5)) * (0.85 + 0.3 * at.y) * (1.0 + AGED * (fract(random * 7.0) - 0.5));
}

// Brightness of bark, about 1 or dark: furrows up the trunk, or bands across a pale one.
//   at:    round the wood and up it, both 0..1
//   kind:  0 furrows, 0.125 bands
float bark_tone(vec2 at, float kind)
{
    float turn = 6.2831853 * at.x;
    float furrow = sin(11.0 * turn + 2.3 * sin(3.0 * turn + 90.0 * at.y) + 1.3 * sin(231.0 * at.y));
    float row = 130.0 * at.y;
    float of_row = fract(sin(floor(row) * 12.9898) * 43.758);
    float middle = abs(fract(at.x + 7.3 * of_row) - 0.5);
    float band = step(0.55, of_row) * step(middle, 0.30 * of_row) * step(abs(fract(row) - 0.5), 0.30 * of_row - 0.4 * middle);
    float rough = 0.62 + 0.5 * smoothstep(-0.9, 0.7, furrow);
    return kind > 0.06 ? 1.0 - 0.82 * band : rough;
}
