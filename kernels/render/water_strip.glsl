// A strip of water that is never thinner than a pixel can show: what is lost in width goes into its coverage.
// Oracle: tests/render/test_water.py.
const float THINNEST = 1.25; // px across

// xy: a place in the picture (px), moved off its centreline as far as the strip needs; z: coverage, 0 ... 1.
//   at       the place as it is seen; centre: that on the centreline beside it; edge: that at the water's edge, px
//   along    direction of the centreline in the picture, any length
vec3 widened(vec2 at, vec2 centre, vec2 edge, vec2 along)
{
    vec2 across = vec2(-along.y, along.x) / max(length(along), 1e-9);
    float width = 2.0 * abs(dot(edge - centre, across));
    float times = max(THINNEST / max(width, 1e-6), 1.0);
    float off = dot(at - centre, across);
    // Where it is seen so flatly that both banks fall together their order is all that is left of them.
    off = clamp(off * (times - 1.0), -THINNEST, THINNEST);
    return vec3(at + across * off, 1.0 / times);
}
