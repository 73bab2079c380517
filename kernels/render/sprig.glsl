// The leaves of a spray, cut out of a sheet. Pure; the same in NumPy float64: look/tree_levels.py.

const float LEAF_PAIRS = 5.0;    // of leaves along a spray
const float LEAF_FORWARD = 0.55; // inclination of a leaf towards the spray's tip, length over width
const float LEAF_FULL = 0.47;    // half a leaf's width at its widest, of the distance between leaves
const float COMBS = 8.0;         // of needles along a spray
const float NEEDLE_FORWARD = 0.5;
const float NEEDLE_FULL = 0.36;
const float TWIG = 0.06;         // half the twig's width, of the sheet's

// Positive inside leaves.
//   at:   across the sheet -1..1 and along it 0..1
//   kind: 0 and 0.125 solid (bark, banded bark), 0.5 pairs of leaves, 1 needles
float leaf_mask(vec2 at, float kind)
{
    bool needles = kind > 0.75;
    float away = abs(at.x);
    float forward = needles ? NEEDLE_FORWARD : LEAF_FORWARD;
    float count = needles ? COMBS : LEAF_PAIRS;
    float row = (at.y - 0.3 * forward * away) * count + (at.x < 0.0 ? 0.5 : 0.0);
    // Length of leaves along the twig: short at root and tip.
    float along = clamp(at.y - 0.3 * forward * away, 0.0, 1.0);
    float reach = needles ? sqrt(1.0 - along * along) * min(6.0 * along + 0.5, 1.0)
                          : sqrt(max(1.0 - along * along, 0.0)) * min(4.0 * along + 0.35, 1.0);
    // Leaves of a broad spray vary in length.
    float grown = needles ? 1.0 : 0.7 + 0.3 * fract(floor(row) * 0.618034 + (at.x < 0.0 ? 0.37 : 0.0));
    float out_ = away / max(reach * grown, 1e-3);
    float full = needles ? NEEDLE_FULL * (1.0 - 0.5 * out_) : LEAF_FULL * 2.0 * sqrt(max(out_ * (1.0 - out_), 0.0));
    float leaf = out_ < 1.0 ? full - abs(fract(row) - 0.5) : -1.0;
    float twig = TWIG - away;
    return kind < 0.25 ? 1.0 : max(leaf, twig);
}

// Brightness of the leaf at a position, mean 1: leaves vary, and their ends are young.
float leaf_tone(vec2 at, float kind)
{
    bool needles = kind > 0.75;
    float row = (at.y - 0.3 * LEAF_FORWARD * abs(at.x)) * LEAF_PAIRS + (at.x < 0.0 ? 0.5 : 0.0);
    float of_leaf = fract(sin(floor(row) * 12.9898 + (at.x < 0.0 ? 4.1 : 0.0)) * 43.758);
    float rib = smoothstep(0.0, 0.12, abs(fract(row) - 0.5)); // of a leaf, darker
    return kind < 0.25 ? 1.0 : needles ? 0.75 + 0.5 * at.y : (0.72 + 0.56 * of_leaf) * (0.85 + 0.15 * rib);
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
