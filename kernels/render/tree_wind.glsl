// Plants in the wind: all of a plant leans and sways with the square of the height, its boughs swing by themselves, its
// leaves flutter. Nothing moves without wind, and no foot ever does. Oracle: tests/render/test_tree_wind.py.

const float LEAN = 0.16;         // of its height, in a storm
const float STORM = 18.0;        // m/s, wind at which half of that is reached
const float GUST_LENGTH = 70.0;  // m, from gust to gust
const float SWAY_PACE = 1.1;     // rad/s, of a plant
const float BOUGH_PACE = 2.6;    // rad/s
const float FLUTTER_PACE = 8.5;  // rad/s, of leaves
const float FLUTTER = 0.012;     // heights of the plant, in a storm

// How strongly it blows at a place, about 1: gusts that travel with the wind.
float gust(vec2 place, vec2 wind, float time)
{
    float speed = length(wind);
    vec2 along = speed > 0.0 ? wind / speed : vec2(1.0, 0.0);
    float run = dot(place, along) - speed * time, aside = dot(place, vec2(-along.y, along.x));
    float turn = 6.2831853 / GUST_LENGTH;
    return 1.0 + 0.45 * sin(run * turn + 1.7 * sin(aside * turn * 0.37)) + 0.25 * sin(run * turn * 2.3 + aside * turn);
}

// How far a point of a plant is moved, m.
//   foot:  of the plant, m in the world, modulo any long period
//   at:    point, in heights of the plant from its foot
//   tall:  its height, m
//   phase: of the bough, 0..1
//   leafy: 0 wood, 1 leaf
//   blows: how strongly, see gust
vec3 swayed(vec2 foot, vec3 at, float tall, float phase, float leafy, vec2 wind, float blows, float time)
{
    float speed = length(wind);
    if (speed <= 0.0 || at.z <= 0.0) return vec3(0.0);
    vec2 along = wind / speed;
    float force = speed * speed / (speed * speed + STORM * STORM);
    float blow = force * blows;
    float own = dot(foot, vec2(0.37, 0.59)); // plants do not sway in step
    float slow = SWAY_PACE * pow(max(tall, 0.5) / 12.0, -0.5); // high ones are slower
    float lean = LEAN * at.z * at.z * (blow + 0.35 * force * sin(slow * time + own));
    vec2 level = along * lean + vec2(-along.y, along.x) * (0.25 * LEAN * force * at.z * at.z * sin(0.83 * slow * time + 2.0 * own));
    float out_ = length(at.xy);
    float bough = 0.10 * blow * out_ * sin(BOUGH_PACE * time + 6.2831853 * phase + own);
    vec3 quiver = leafy * FLUTTER * blow * vec3(sin(FLUTTER_PACE * time + 40.0 * at.x + 6.2831853 * phase),
        sin(1.13 * FLUTTER_PACE * time + 40.0 * at.y), sin(0.91 * FLUTTER_PACE * time + 40.0 * at.z));
    float held = min(at.z * 12.0, 1.0); // so that the foot of a shrub's leaves stays too
    return tall * (vec3(level, -0.5 * dot(level, level)) + held * (vec3(0.0, 0.0, bough) + quiver));
}
