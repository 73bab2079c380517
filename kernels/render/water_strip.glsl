// Widens a strip of water to a visible width; coverage compensates.
// Oracle: tests/render/test_water.py.
const float THINNEST = 1.25; // px across

// xy: position in the picture (px), moved away from the centreline as needed; z: coverage, 0 ... 1.
//   at       projected position; centre: of the nearest point of the centreline; edge: of the water's edge, px
//   along    direction of the centreline in the picture, any length
vec3 widened(vec2 at, vec2 centre, vec2 edge, vec2 along)
{
    vec2 across = vec2(-along.y, along.x) / max(length(along), 1e-9);
    float width = 2.0 * abs(dot(edge - centre, across));
    float times = max(THINNEST / max(width, 1e-6), 1.0);
    float off = dot(at - centre, across);
    // At grazing angles both banks coincide, and only their order is known.
    off = clamp(off * (times - 1.0), -THINNEST, THINNEST);
    return vec3(at + across * off, 1.0 / times);
}
