#version 430 core
// Plant at a scattered point, captured by transform feedback (render/grass.py) as a plant has many vertices; its height
// is 0 where none grows.
// Macros of render/material_macros.py say which materials are meadows and undergrowth.
//   KIND 0 tufts of a meadow, 1 tall grass in ear, 2 flowers, 3 ferns
#include "render/frame.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"
#include "render/surface_map.glsl"
#include "render/scatter.glsl"
#include "render/tree_wind.glsl"
#include "render/variety.glsl"
#if APPEARANCE
#include "render/appearance.glsl"
#endif

#define MEADOW 0
#define TALL 1
#define FLOWER 2
#define FERN 3

in vec2 corner; // of the cell, relative to the eye, m
in uvec2 seed;  // the cell's hash, the point's rank

uniform vec4 scatter_layer; // points a cell, distance of full density, draw distance, cell size (m)
uniform float spread;  // area of a point relative to the best quality: blades are wider by it
uniform sampler2DArray material_colour;
uniform sampler2D scene;       // the bare ground in the picture
uniform sampler2D scene_depth;
uniform vec2 wind;   // where it blows to, m/s, east and north
uniform float clock; // s

out vec4 foot_height;  // xyz: foot relative to the eye, m; w: height, m
out vec4 turn;   // xy: cosine and sine of its rotation; z: half the width of a blade, m; w: distance over the draw distance
out vec4 albedo; // rgb; w: bend by the wind to the east, heights
out vec4 ground; // xyz: normal; w: sun visibility
out vec4 sky;    // rgb: irradiance of the sky; w: bend to the north
out vec4 under;  // rgb: radiance of the ground at its foot; w: 1 if that is in the picture
out vec4 veil;   // rgb: in-scattered light; w: transmittance of the air

const float BLADE = 0.0026;     // m, half the width of a blade
const float FLOWER_PART = 0.0040; // m, the same of flowers' parts
const float LEAST = 0.42;       // px, smallest half width of a blade
const float LEAST_PART = 0.13;  // px, the same of flowers, whose heads are several times as wide
const float LIVELY = 1.35;      // brightness of a blade over the ground's texture, which includes the gaps
const float SAME = 0.03;        // relative distance within which the picture at a foot is the ground there
const float DRY = 0.45, VERY_DRY = 0.75; // aridity, see the sketch's [climate]
const vec3 HAY = vec3(0.380, 0.268, 0.125); // albedo of dry bunches
const vec2 REED_BED = vec2(0.05, 0.2); // share of a wet bed between which grass turns to reeds
const vec2 REED_FAR = vec2(40.0, 80.0); // m, between which reeds vanish
const float WIDEST = 2.5; // of distant tufts, which stand for several, over near ones
const vec2 REED_HEIGHT = vec2(0.9, 1.9); // m
const float REED = 0.0055; // m, half the width of a leaf
const vec3 REED_TINT = vec3(0.95, 0.92, 1.15); // over the meadow's
const float CROP_TEXEL = 0.12;  // m, of what is painted about a plant
const vec2 CROP = vec2(0.88, 0.94); // share that is painted, from which on it is a field (kernels/appearance.clh)
const vec2 ROAD = vec2(0.965, 0.99); // … and a road
const float CROP_HEIGHT = 0.75; // m
const float SUN_WARMTH = 0.5;   // of the height, where shadow maps are sampled

// Mean of the ground's texture, so that tufts match the ground around them.
vec3 meadow_albedo(int layer, vec4 wide, vec4 middle, vec4 small)
{
    vec3 mean = textureLod(material_colour, vec3(0.5, 0.5, float(layer)), 20.0).rgb;
    return mean * mean * variety(layer, wide, middle, small);
}

// Of the kinds of flowers that foot_height in patches.
vec3 petal_colour(float number)
{
    return number < 0.30 ? vec3(0.70, 0.70, 0.66) : number < 0.55 ? vec3(0.74, 0.54, 0.04)
        : number < 0.75 ? vec3(0.34, 0.22, 0.55) : vec3(0.66, 0.62, 0.50);
}

void main()
{
    float capacity = scatter_layer.x, full = scatter_layer.y, draw_distance = scatter_layer.z;
    uint h = point_hash(seed.x, seed.y);
    vec2 place = corner + scatter_layer.w * scatter_position(seed.x, seed.y);
    vec4 drawn = drawn_surface(place);
    vec3 foot = vec3(place, drawn.z);
    float away = length(foot);
    float up = drawn.w > 0.0 ? presence(seed.y, capacity, away, full, draw_distance) : 0.0;

    vec4 weights[WEIGHT_WORDS];
    drawn_weights(place, weights);
    float turf = MEADOW_SHARE(weights);
    vec2 world = place + eye.xy;
    vec4 wide = textureLod(noise_field, world / 4096.0, 0.0);
    vec4 middle = textureLod(noise_field, world / 512.0 + 0.37, 0.0);
    vec4 small = textureLod(noise_field, world / 64.0 + 0.71, 0.0);
    vec4 fine = textureLod(noise_field, world / 17.0 + 0.13, 0.0);

    float a = unit_float(hash32(h + 3u)), b = unit_float(hash32(h + 4u)), c = unit_float(hash32(h + 5u));
    float fray = 2.0 * (middle.x * 0.45 + small.x * 0.4) * turf * (1.0 - turf);
    float meadow = smoothstep(0.34, 0.62, turf + fray);
    float wood = smoothstep(0.35, 0.8, UNDERGROWTH_SHARE(weights));
    vec4 tussocks = textureLod(noise_field, world / 5.3 + 0.29, 0.0);
    float lush = smoothstep(-0.9, 1.1, 0.5 * small.y + 0.35 * middle.z + 0.65 * fine.x + 0.55 * tussocks.x);
    // Meadows of several materials stand in patches, and mix at their borders.
    float pick = turf * smoothstep(-0.9, 0.9, 0.5 * small.x + 0.6 * fine.y + 0.6 * (a - 0.5)), sward = 1.0;
    int layer = 0;
    MEADOW_KINDS
    vec3 colour = meadow_albedo(layer, wide, middle, small)
        * mix(vec3(1.16, 1.05, 0.98), vec3(0.82, 0.92, 0.93), smoothstep(-0.5, 0.5, tussocks.w));
    float tall = mix(0.10, 0.50, lush * sqrt(lush)) * sward, half_width = BLADE, least = LEAST, chance;
#if KIND == MEADOW
    chance = max(meadow, 0.45 * wood * smoothstep(-0.2, 0.5, small.z));
    tall *= (0.6 + 0.8 * a) * mix(0.5, 1.0, meadow);
    colour *= mix(vec3(1.25, 1.08, 1.0), vec3(1.0), meadow);
#elif KIND == TALL
    chance = meadow * (0.02 + 0.98 * smoothstep(0.0, 0.5, 0.6 * small.w + 0.45 * fine.w + 0.35 * middle.x + 0.3 * tussocks.y));
    tall = mix(0.34, 0.80, lush) * (0.6 + 0.7 * a) * sqrt(sward);
    colour = mix(colour * vec3(1.12, 1.03, 0.95), HAY * 0.6, smoothstep(0.55, 1.0, b + 0.35 * fine.z) * 0.8); // last year's
    float reeds = smoothstep(REED_BED.x, REED_BED.y, WET_SHARE(weights)) * smoothstep(0.15, 0.4, turf);
    float near = 1.0 - smoothstep(REED_FAR.x, REED_FAR.y, away); // farther off they are specks on the water
    chance = max(chance, near * reeds * smoothstep(-0.5, 0.2, small.x + 0.6 * fine.w));
    tall = mix(tall, mix(REED_HEIGHT.x, REED_HEIGHT.y, lush) * (0.7 + 0.4 * a), reeds);
    half_width = mix(half_width, REED, reeds);
    colour *= mix(vec3(1.0), REED_TINT, reeds);
    // In dry lands single bunches foot_height on sand and soil.
    float bunch = smoothstep(DRY, VERY_DRY, trees.y) * BUNCH_SHARE(weights) * 0.09 * smoothstep(-0.2, 0.7, 0.6 * small.w + 0.5 * fine.y);
    colour = bunch > chance ? HAY * mix(0.75, 1.2, b) : colour;
    tall = bunch > chance ? mix(0.22, 0.45, a) : tall;
    chance = max(chance, bunch);
#elif KIND == FLOWER
    // In drifts of a kind, and in clumps within a drift.
    chance = meadow * (0.004 + 0.996 * smoothstep(0.05, 0.45, 0.7 * small.z + 0.5 * fine.z + 0.35 * tussocks.z));
    tall = (tall + 0.08) * (0.8 + 0.5 * a);
    half_width = FLOWER_PART * (0.8 + 0.5 * c);
    least = LEAST_PART;
    vec4 kinds = textureLod(noise_field, world / 97.0 + 0.51, 0.0);
    colour = petal_colour(0.5 + 0.65 * kinds.x + 0.10 * (a - 0.5));
#else
    chance = wood * smoothstep(0.0, 0.5, small.z + 0.5 * fine.x);
    tall = mix(0.30, 0.62, lush) * (0.7 + 0.6 * a);
    colour = vec3(0.048, 0.082, 0.026) * mix(vec3(0.8, 0.95, 1.0), vec3(1.35, 1.05, 0.8), b);
#endif
#if APPEARANCE
    // Crops stand close, and have their own colour; nothing grows on roads.
    vec3 through;
    vec4 painted = painted_about(place, CROP_TEXEL, through);
    float opaque = 1.0 - max(max(through.r, through.g), through.b);
    float crop = smoothstep(CROP.x, CROP.y, opaque);
#if KIND == FLOWER || KIND == FERN
    chance *= 1.0 - crop;
#else
    chance = mix(chance, smoothstep(0.3, 0.6, turf), crop);
    tall = mix(tall, CROP_HEIGHT * (0.85 + 0.3 * a) * (KIND == MEADOW ? 0.7 : 1.0), crop);
    colour = colour * through + painted.rgb * painted.a;
#endif
    chance *= 1.0 - smoothstep(ROAD.x, ROAD.y, opaque);
#endif
    up *= step(unit_float(hash32(h + 6u)), chance * 0.999);
    tall *= sqrt(up);

    // Frustum culling, with a margin for leaning blades and roots below the edge.
    vec4 clip = to_clip * vec4(foot + vec3(0.0, 0.0, 0.5 * tall), 1.0);
    float soft = clip.w + 1.5 * tall + 0.2;
    if (clip.w < -tall || abs(clip.x) > soft * 1.3 || abs(clip.y) > soft * 1.3) up = 0.0;

    float angle = 6.2831853 * c;
    float wider = clamp(away / full, 1.0, WIDEST);
    float grown = min(up, 1.0);
    foot_height = vec4(foot - vec3(0.0, 0.0, 0.02 * tall), up > 0.0 ? tall : 0.0);
    turn = vec4(cos(angle), sin(angle), max(half_width * wider * spread, least * trees.z * away) * grown, away / draw_distance);

    float speed = length(wind);
    vec2 along = speed > 0.0 ? wind / speed : vec2(0.0);
    float force = speed * speed / (speed * speed + 60.0);
    float blow = speed > 0.0 ? gust(world, wind, clock) * (0.7 + 0.6 * fine.w + 0.3 * sin(3.1 * clock + 6.2831853 * b) ) : 0.0;
    vec2 bend = along * force * 0.75 * blow;
    bend += speed > 0.0 ? 0.16 * force * vec2(sin(4.7 * clock + 40.0 * a), sin(5.3 * clock + 40.0 * b)) : vec2(0.0);

    colour *= LIVELY * mix(0.75, 1.25, b)
        * mix(vec3(1.14, 1.0, 0.92), vec3(0.92, 1.0, 1.04), a);
    albedo = vec4(colour, bend.x);
    vec3 normal = drawn_normal(drawn);
    vec4 light = ground_light(place);
    vec3 middle_of_it = foot + vec3(0.0, 0.0, SUN_WARMTH * tall);
    ground = vec4(normal, light.r * tree_shade(middle_of_it, normal) * cloud_shadow(foot));
    sky = vec4(sky_irradiance(normal) * light.g, bend.y);
    vec3 added = through_air(vec3(0.0), foot);
    veil = vec4(added, through_air(vec3(1.0), foot).g - added.g);
    // Distant plants take on the ground's radiance, so that their border is invisible.
    vec4 at_foot = to_clip * vec4(foot, 1.0);
    vec3 on_screen = at_foot.xyz / max(at_foot.w, 1e-3) * 0.5 + 0.5;
    bool inside = at_foot.w > 0.0 && all(greaterThan(on_screen.xy, vec2(0.0))) && all(lessThan(on_screen.xy, vec2(1.0)));
    float seen_at = textureLod(scene_depth, on_screen.xy, 0.0).r * 2.0 - 1.0;
    vec4 seen_point = from_clip * vec4(on_screen.xy * 2.0 - 1.0, seen_at, 1.0);
    float behind = away - length(seen_point.xyz / seen_point.w);
    under = vec4(textureLod(scene, on_screen.xy, 0.0).rgb, inside && abs(behind) < SAME * away ? 1.0 : 0.0);
    gl_Position = vec4(0.0);
}
