// How a material's colour varies over the land, the same for the ground and for what lies and grows on it.
#define GRASS 0
#define ROCK 2
#define SCREE 3
#define FOREST_FLOOR 7
#define CANOPY 8

uniform vec3 tints[9]; // climate's colour of a layer

// Slowly, so that it is never quite the same twice.
//   wide, middle, small  noise of about 1000, 100 and 10 m
vec3 variety(int layer, vec4 wide, vec4 middle, vec4 small)
{
    vec3 colour = tints[layer] * (1.0 + 0.13 * middle.w + 0.10 * small.w);
    if (layer == GRASS || layer == FOREST_FLOOR) {
        float dry = smoothstep(-0.75, 0.95, 0.9 * wide.x + 0.6 * middle.y + 0.35 * small.z);
        colour *= mix(vec3(0.78, 0.92, 0.80), vec3(1.26, 1.10, 0.98), dry);
    }
    if (layer == CANOPY) colour *= mix(vec3(0.75, 0.85, 0.85), vec3(1.25, 1.12, 0.9), smoothstep(-0.6, 0.6, middle.x));
    if (layer == ROCK || layer == SCREE)
        colour *= mix(vec3(0.86, 0.90, 0.96), vec3(1.10, 1.02, 0.92), smoothstep(-0.7, 0.7, wide.y + 0.5 * middle.z));
    return colour;
}
