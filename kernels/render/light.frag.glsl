#version 430 core
// Light map of a height map: r sun visibility 0..1 with soft edges, g sky visibility, b height (m).
// CLOSE: whether the map is close to the eye, with rays continuing on two wider ones.
// SHADOWS: whether the ground throws shadows.
#if CLOSE
const int SUN_STEPS = 58;
const int SKY_STEPS = 4;  // the wider map has the occlusion further away
#else
const int SUN_STEPS = 40;
const int SKY_STEPS = 6;
#endif
const float LONGER = 1.15; // growth of steps towards the sun
const int DIRECTIONS = 8;

uniform sampler2D heights;     // this map, m, row 0 south
uniform sampler2D far_heights; // a wider and coarser one
uniform vec4 frame;            // xy: this map's south-west corner in the far map's uv; z: width over the far one's; w: m
uniform sampler2D widest_heights; // for a close map: the widest one
uniform sampler2D far_light;   // light of the wider map
uniform vec4 widest;           // as frame, in that
uniform vec3 sun;              // unit vector towards it
uniform float softness;        // tangent of the penumbra's half angle
uniform float highest_ground;  // m, of all the maps

in vec2 uv;
out vec4 light;

float height_at(vec2 at, float lod)
{
    vec2 edge = abs(at - 0.5);
    if (max(edge.x, edge.y) < 0.5) return textureLod(heights, at, lod).r;
    vec2 there = frame.xy + at * frame.z;
#if CLOSE
    edge = abs(there - 0.5);
    if (max(edge.x, edge.y) >= 0.5)
        return textureLod(widest_heights, widest.xy + at * widest.z, max(0.0, lod + log2(widest.z))).r;
#endif
    return textureLod(far_heights, there, max(0.0, lod + log2(frame.z))).r;
}

// Without the wider map, for nearby samples.
float own_height_at(vec2 at, float lod) { return textureLod(heights, at, lod).r; }

float sun_visibility(float start, float texel)
{
    float across = length(sun.xy);
    if (across < 1e-4) return 1.0;
    vec2 ahead = sun.xy / across;
    float climb = sun.z / across;
    float visible = 1.0;
    float gone = 1.2;
    for (int i = 0; i < SUN_STEPS; ++i) {
        float run = gone * texel; // m
        float penumbra = run * softness + 0.35 * texel;
        if (visible <= 0.0 || (start + run * climb - highest_ground >= penumbra && climb > softness)) break;
        float room = start + run * climb - height_at(uv + ahead * run / frame.w, log2(gone) * 0.5 - 1.0);
        visible = min(visible, smoothstep(-1.0, 1.0, room / penumbra));
        gone *= LONGER;
    }
    return visible;
}

float sky_visibility(float start, float texel)
{
    float e = texel / frame.w;
    vec2 slope = vec2(own_height_at(uv + vec2(e, 0.0), 0.0) - own_height_at(uv - vec2(e, 0.0), 0.0),
                      own_height_at(uv + vec2(0.0, e), 0.0) - own_height_at(uv - vec2(0.0, e), 0.0)) / (2.0 * texel);
    float open = 0.0;
    for (int k = 0; k < DIRECTIONS; ++k) {
        float angle = (float(k) + 0.5) * 6.2831853 / float(DIRECTIONS);
        vec2 ahead = vec2(cos(angle), sin(angle));
        float plane = dot(slope, ahead); // what tilts the whole surface is not occlusion
        float highest = 0.0;
        float gone = 1.5;
        for (int i = 0; i < SKY_STEPS; ++i) {
            float run = gone * texel;
            float rise = (own_height_at(uv + ahead * run / frame.w, round(log2(gone) - 0.5)) - start) / run;
            highest = max(highest, rise - plane);
            gone *= 2.2;
        }
        open += 1.0 / (1.0 + highest * highest);
    }
    return open / float(DIRECTIONS);
}

void main()
{
    float texel = frame.w / float(textureSize(heights, 0).x);
    float start = height_at(uv, 0.0);
#if SHADOWS
    float lit = sun_visibility(start, texel);
#else
    float lit = 1.0;
#endif
    float open = sky_visibility(start, texel);
#if CLOSE
    open *= textureLod(far_light, frame.xy + uv * frame.z, 0.0).g;
#endif
    light = vec4(lit, open, start, 1.0);
}
