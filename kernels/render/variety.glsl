// Large-scale colour variation of materials, the same for terrain, rocks and grass.
//   LAYERS      number of texture layers
//   VARIATIONS  statements that vary the colour of layers (render/material_macros.py)
uniform vec3 tints[LAYERS]; // climate tint of a layer

//   wide, middle, small  noise of about 1000, 100 and 10 m
vec3 variety(int layer, vec4 wide, vec4 middle, vec4 small)
{
    vec3 colour = tints[layer] * (1.0 + 0.13 * middle.w + 0.10 * small.w);
    VARIATIONS
    return colour;
}
