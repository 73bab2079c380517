// Wetness of banks. Pure; oracle: tests/render/test_water.py.
const float WET_LOW = 0.14;  // m above the water, fully wet
const float WET_HIGH = 0.52; // dry
const float WET_WIDE = 7.0;  // m from the water, dry at any height

// 0 dry ... 1 wet.
//   above    height above the water, m
//   room     m from the shore, negative in the bank
//   uneven   noise added to the height, m
float wetness_beside(float above, float room, float uneven)
{
    float low = 1.0 - smoothstep(WET_LOW, WET_HIGH, above + uneven);
    return low * smoothstep(-WET_WIDE, -0.4 * WET_WIDE, room + 4.0 * uneven);
}
