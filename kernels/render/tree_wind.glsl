// Plants in the wind: a plant leans and sways with the square of the height, its boughs swing, nearby leaves (SPRIGS 1)
// flutter. Nothing moves without wind, and no foot ever does. Oracle: tests/render/test_trees.py.
#ifndef SPRIGS
#define SPRIGS 1
#endif

const float LEAN = 0.16;         // of its height, in a storm
const float STORM = 18.0;        // m/s, wind of half of that
const float GUST_LENGTH = 70.0;  // m, from gust to gust
const float SWAY_PACE = 1.1;     // rad/s, of a plant
const float BOUGH_PACE = 2.6;    // rad/s
const float FLUTTER_PACE = 8.5;  // rad/s, of leaves
const float FLUTTER = 0.012;     // heights of the plant, in a storm

// Relative strength of gusts, mean 1, that travel with the wind.
float gust(vec2 place, vec2 wind, float time)
{
    float speed = length(wind);
    vec2 along = speed > 0.0 ? wind / speed : vec2(1.0, 0.0);
    float run = dot(place, along) - speed * time, aside = dot(place, vec2(-along.y, along.x));
    float turn = 6.2831853 / GUST_LENGTH;
    return 1.0 + 0.45 * sin(run * turn + 1.7 * sin(aside * turn * 0.37)) + 0.25 * sin(run * turn * 2.3 + aside * turn);
}

// Sway of a plant. xy: displacement of its top, heights; z: wind strength; w: phase, rad, so that plants are not in step.
//   foot: m in the world, modulo any long period
//   tall: its height, m
vec4 sway_of(vec2 foot, float tall, vec2 wind, float time)
{
    float speed = length(wind);
    vec2 along = speed > 0.0 ? wind / speed : vec2(0.0);
    float force = speed * speed / (speed * speed + STORM * STORM);
    float blow = force * gust(foot, wind, time);
    float own = dot(foot, vec2(0.37, 0.59));
    float slow = SWAY_PACE * pow(max(tall, 0.5) / 12.0, -0.5); // tall ones are slower
    float lean = LEAN * (blow + 0.35 * force * sin(slow * time + own));
    float aside = 0.25 * LEAN * force * sin(0.83 * slow * time + 2.0 * own);
    return vec4(along * lean + vec2(-along.y, along.x) * aside, blow, own);
}

// Displacement of a point of a plant, m.
//   at:    point, in heights of the plant from its foot
//   sway:  see sway_of
//   phase: of the bough, 0..1
//   leafy: 0 wood, 1 leaf
vec3 swayed(vec3 at, float tall, vec4 sway, float phase, float leafy, float time)
{
    vec2 level = sway.xy * at.z * at.z;
    float held = clamp(at.z * 12.0, 0.0, 1.0); // fixes the leaves at a shrub's foot
    float bough = 0.10 * length(at.xy) * sin(BOUGH_PACE * time + 6.2831853 * phase + sway.w);
    vec3 own = vec3(0.0, 0.0, bough);
#if SPRIGS
    own += leafy * FLUTTER * vec3(sin(FLUTTER_PACE * time + 40.0 * at.x + 6.2831853 * phase),
        sin(1.13 * FLUTTER_PACE * time + 40.0 * at.y), sin(0.91 * FLUTTER_PACE * time + 40.0 * at.z));
#endif
    return tall * (vec3(level, -0.5 * dot(level, level)) + held * sway.z * own);
}
