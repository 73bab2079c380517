#version 430 core
// A vertex of a ground plant, lit per vertex as blades are a few pixels wide.
//   KIND as in grass_plant.vert.glsl
#include "render/frame.glsl"

#define FLOWER 2

in vec3 local_position;  // on a blade's middle line, heights of the plant
in vec3 side;   // offset by one half width
in vec3 blade; // share of the way up the blade, random number 0..1 of the blade, paint: 0 leaf, 1 petal, 2 stalk

in vec4 foot_height; // of the plant, captured from grass_plant.vert.glsl
in vec4 turn;
in vec4 albedo;
in vec4 ground;
in vec4 sky;
in vec4 under;
in vec4 veil;

out vec3 seen;

const float PETAL = 1.0;     // keeps its colour at a distance
const float OWN = 0.08;      // share of the draw distance up to which a plant is shaded itself …
const float LIKE_GROUND = 0.6; // … and from which it has the radiance of the ground at its foot
const float ROOT_SUN = 0.22; // sun visibility at the root among its neighbours …
const float ROOT_SKY = 0.38; // … and of the sky
const float STRAW_SHARE = 0.17; // of the blades are dry
const float GLOSS = 0.022;     // of the sun, at its brightest
const float SKY_GLOSS = 0.022; // of the sky
const vec3 POLLEN = vec3(0.62, 0.40, 0.03); // albedo of the middle of a flower
const vec3 STEM = vec3(0.060, 0.098, 0.028);
const vec3 EAR = vec3(1.5, 1.3, 1.05);     // albedo of stalks and ears over a green blade's
const vec3 STRAW = vec3(2.3, 1.75, 1.35); // their albedo over a green one's

void main()
{
    mat2 around = mat2(turn.x, turn.y, -turn.y, turn.x);
    float t = blade.x, tone = blade.y;
    vec3 at = vec3(around * local_position.xy, local_position.z) * foot_height.w;
    vec3 edge = vec3(around * side.xy, side.z) * turn.z;
    vec2 bend = vec2(albedo.w, sky.w) * (local_position.z * local_position.z * (0.8 + 0.4 * tone));
    at += foot_height.w * vec3(bend, -0.45 * dot(bend, bend));
    vec3 position = foot_height.xyz + at + edge;

    vec3 to_eye = -normalize(position);
    vec3 across = normalize(vec3(-edge.y, edge.x, 0.3 * turn.z) + vec3(0.0, 0.0, 1e-5));
    float facing = dot(across, to_sun.xyz);
    float level = max(dot(ground.xyz, to_sun.xyz), 0.0);
    bool lit_side = facing * dot(across, to_eye) > 0.0;
    vec3 colour = albedo.rgb;
    float flesh = lit_side ? 1.0 : 0.75;
    if (blade.z > 1.5) colour *= EAR;
    else if (blade.z < 0.5) {
        float straw = tone < STRAW_SHARE ? 0.8 : 0.0;
        colour *= mix(vec3(1.0), STRAW, straw);
        colour *= mix(vec3(0.72, 0.78, 0.80), vec3(1.12, 1.06, 0.92), t);
    }
#if KIND == FLOWER
    colour = blade.z == PETAL ? mix(POLLEN, albedo.rgb, smoothstep(0.1, 0.3, t)) : STEM;
#endif
    float high = clamp(local_position.z, 0.0, 1.0);
    float open_sun = mix(ROOT_SUN, 1.0, pow(high, 0.8));
    float open_sky = mix(ROOT_SKY, 1.0, high);
    float direct = 0.45 * level + 0.55 * flesh * abs(facing);
    // Long thin blades shine across their length (Kajiya & Kay 1989).
    vec3 lengthwise = normalize(vec3(at.xy, at.z + 0.02 * foot_height.w));
    float shine = dot(lengthwise, normalize(to_eye + to_sun.xyz));
    float gloss = GLOSS * pow(max(1.0 - shine * shine, 0.0), 12.0) * high;
    vec3 through = vec3(1.25, 1.15, 0.45) * pow(max(-dot(to_eye, to_sun.xyz), 0.0), 3.0) * 0.55 * (lit_side ? 0.3 : 1.0);
    vec3 lit = colour / PI * (direct + through) * sun_light.rgb * ground.w * open_sun;
    lit += colour / PI * sky.rgb * open_sky;
    lit += gloss * sun_light.rgb * ground.w * open_sun + SKY_GLOSS / PI * sky.rgb * high * high;
    float far = blade.z == PETAL ? 0.0 : under.w * smoothstep(OWN, LIKE_GROUND, turn.w);
    vec3 as_ground = under.rgb * mix(0.86, 1.14, tone) * mix(0.9, 1.06, high);
    seen = mix(lit * veil.w + veil.rgb, as_ground, far);
    gl_Position = to_clip * vec4(position, 1.0);
}
