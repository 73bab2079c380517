// Large-scale colour variation of materials, the same for terrain, rocks and grass.
#define GRASS 0
#define ROCK 2
#define SCREE 3
#define FOREST_FLOOR 7
#define CANOPY 8

uniform vec3 tints[9]; // climate tint of a layer

//   wide, middle, small  noise of about 1000, 100 and 10 m
vec3 variety(int layer, vec4 wide, vec4 middle, vec4 small)
{
    vec3 colour = tints[layer] * (1.0 + 0.13 * middle.w + 0.10 * small.w);
    if (layer == FOREST_FLOOR) colour *= mix(vec3(0.80, 0.92, 0.90), vec3(1.15, 1.08, 1.05), smoothstep(-0.6, 0.8, middle.y + 0.6 * small.z));
    if (layer == GRASS) {
        // Lush, dry and sedge meadows.
        float dry = smoothstep(-0.2, 1.1, 0.9 * wide.x + 0.75 * middle.y + 0.45 * small.z);
        float sedge = smoothstep(0.1, 0.9, 0.5 * wide.w + 0.8 * middle.x + 0.6 * small.y);
        colour *= mix(vec3(1.04, 0.96, 1.04), vec3(1.62, 1.22, 1.16), dry);
        colour *= mix(vec3(1.0), vec3(0.66, 0.74, 0.76), sedge);
    }
    if (layer == CANOPY) colour *= mix(vec3(0.75, 0.85, 0.85), vec3(1.25, 1.12, 0.9), smoothstep(-0.6, 0.6, middle.x));
    if (layer == ROCK || layer == SCREE)
        colour *= mix(vec3(0.80, 0.83, 0.87), vec3(1.07, 1.02, 0.95), smoothstep(-0.7, 0.7, wide.y + 0.5 * middle.z));
    return colour;
}
