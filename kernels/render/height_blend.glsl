// Height blending of layers (Zaaijer 2013, §5.4): a layer covers the others where it is higher.

const float BLEND_RANGE = 0.4; // half width of the transition, in heights
const float FAINT = 0.06;      // weight up to which a layer fades in, so that a layer without weight is invisible

// Opacity of a new layer.
//   below  height plus weight of the layers so far
//   above  height of the new layer's texture, 0..1
//   weight of the new layer, 0..1
float layer_share(float below, float above, float weight)
{
    return smoothstep(below - BLEND_RANGE, below + BLEND_RANGE, weight + above) * smoothstep(0.0, FAINT, weight);
}
