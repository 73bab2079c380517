// Height-blended layers (Zaaijer 2013, §5.4): a layer that is laid on others shows where it stands higher than they do.

const float BLEND_RANGE = 0.4; // of heights, either way, over which one layer gives way to the other
const float FAINT = 0.06;      // weight up to which a layer only begins to show, so that one of no weight never does

//   below  height of the layers so far, their weight added
//   above  that of the new layer's texture, 0..1
//   weight its weight, 0..1
float layer_share(float below, float above, float weight)
{
    return smoothstep(below - BLEND_RANGE, below + BLEND_RANGE, weight + above) * smoothstep(0.0, FAINT, weight);
}
