// Reflection of water: screen space, else the height map, else the sky with its clouds. Rays are marched in geometrically
// growing steps (McGuire & Mara 2014 march in pixels; at grazing angles such steps are about even in the picture).
#include "render/frame.glsl"
#include "render/clouds.glsl"
#include "render/cloud_light.glsl"

uniform sampler2D scene;        // radiance of the scene so far
uniform sampler2D scene_depth;  // and its depth buffer
uniform sampler2D near_heights; // m

// Steps along a reflected ray, each longer by a factor: to 500 m, or 2500 m; the first one, m.
#if MATERIALS == 1
const int MARCH = 5;
const float STRIDE = 2.0;
const float FIRST_STEP = 16.0;
#else
const int MARCH = 34;
const float STRIDE = 1.23;
const int TAPS = 4;             // to each side, of the picture along the spread of a mirrored point
const float TAP = 0.45;         // distance of taps, standard deviations
const float ASIDE = 0.3;        // least spread to the sides over the upright one: wave groups fray columns at grazing angles
const float FIRST_STEP = 0.5;
const int HALVINGS = 4;         // bisections of the step with the hit
#endif
const float OVERLOOKED = 100.0; // m, distance of ground over which taps see as far again
const float MARCHED = 2500.0;   // m, length of a march
const float SUNK = 0.4;         // m below the height map that count as a hit
const float THICK = 2.0;        // m, smallest assumed thickness of depth buffer surfaces
const float THICK_STEPS = 2.0;  // and in steps of the ray
const float FAR_OFF = 1e5;      // m, distance of the sky
const float BLURRED = 5.0;      // level of the cloud field that the roughest water mirrors
const float SHADED = 14.0;      // optical depth towards the sun over a cloud's height, 1/km
const float BRIGHTEST = 0.4;    // radiance of clouds over the sun's irradiance
const vec3 GREEN = vec3(0.045, 0.055, 0.026); // albedos of ground outside the picture
const vec3 STONY = vec3(0.20, 0.185, 0.165);

// Whether the height map covers a place; beyond it would repeat its border.
bool is_mapped(vec2 place)
{
    return all(lessThan(abs((place - near_map.xy) * near_map.z - 0.5), vec2(0.5)));
}

float relief_at(vec2 place)
{
    return textureLod(near_heights, (place - near_map.xy) * near_map.z, 0.0).r - eye.z;
}

float land_at(vec3 p) { return is_mapped(p.xy) ? smoothstep(-2.0, 2.0, relief_at(p.xy) - p.z) : 0.0; }

vec3 scene_position(vec2 uv)
{
    vec4 p = from_clip * vec4(vec3(uv, textureLod(scene_depth, uv, 0.0).r) * 2.0 - 1.0, 1.0);
    return p.xyz / p.w;
}

// xy: position in the picture, 0 ... 1; z: weight, 0 outside its upper and lower border. To the left and right the border
// pixels are extended for a while, which is better than a guess for most reflections.
vec3 picture_place(vec4 clip)
{
    vec2 uv = clip.xy / clip.w * 0.5 + 0.5;
    float inside = 1.0 - smoothstep(0.44, 0.5, abs(uv.y - 0.5));
    inside *= 1.0 - smoothstep(0.6, 0.8, abs(uv.x - 0.5));
    return vec3(clamp(uv.x, 0.002, 0.998), uv.y, clip.w > 0.0 ? inside : 0.0);
}

vec3 picture_place(vec3 p) { return picture_place(to_clip * vec4(p, 1.0)); }

// Distance of the scene along the camera's axis, m. Between a leaf and what is far behind it there is nothing to hit.
float axial_depth(vec2 uv)
{
    ivec2 size = textureSize(scene_depth, 0);
    float z = texelFetch(scene_depth, clamp(ivec2(uv * vec2(size)), ivec2(0), size - 1), 0).r * 2.0 - 1.0;
    return 1.0 / (from_clip[2].w * z + from_clip[3].w);
}

// Sky and ground beyond the march, from the picture if visible, else the sky with flat clouds as in sky.frag.glsl; `blur`
// 0 ... 1 by rough water.
vec3 mirrored_sky(vec3 direction, float blur)
{
    vec3 clear = clear_sky(direction), sky = clear;
#if CLOUDS > 0
    vec3 place = direction * to_layer(max(CLOUD_BASE + view_range.y - eye.z, 300.0), max(direction.z, 0.01));
    float density = mix(cloud_density(place.xy), smoothstep(0.0, DENSE, textureLod(cloud_field, cloud_place(place.xy), BLURRED).r), blur);
    float high = sqrt(max(textureLod(cloud_field, cloud_place(place.xy), 1.0).r, 0.0)); // km; thick clouds are dark below
    vec3 lit = sunlit(0.5 + SHADED * high, cloud_phases(dot(direction, to_sun.xyz))) * SUN_GAIN + cloud_ambient(exp(-high / 0.35));
    sky = mix(sky, mix(sky, lit, clear_air(place)), density * (1.0 - overcast) * smoothstep(0.0, 0.1, direction.z));
#endif
#if MATERIALS > 1
    vec3 at = picture_place(direction * FAR_OFF);
    float behind = textureLod(scene_depth, at.xy, 0.0).r;
    float seen = (behind < 0.9999999 ? step(0.5 * MARCHED, length(scene_position(at.xy))) : 1.0 - blur) * at.z;
    // The sun's disc is left to the glitter.
    sky = mix(sky, min(textureLod(scene, at.xy, 0.0).rgb, clear + BRIGHTEST * sun_light.rgb), seen);
#endif
    return sky;
}

// Radiance of ground outside the picture; its material is guessed from its slope.
vec3 guessed_ground(vec3 p)
{
    vec4 light = ground_light(p.xy);
    vec3 albedo = GREEN;
#if MATERIALS > 1
    float texel = max(near_map.w, 1.0);
    vec2 ahead = vec2(relief_at(p.xy + vec2(texel, 0.0)), relief_at(p.xy + vec2(0.0, texel)));
    albedo = mix(albedo, STONY, smoothstep(0.7, 1.0, length(ahead - relief_at(p.xy)) / texel));
#endif
    vec3 down = sun_light.rgb * to_sun.z * light.r + sky_irradiance(vec3(0.0, 0.0, 1.0)) * light.g;
    return through_air(albedo / PI * down, p);
}

// Radiance along a reflected ray, including aerial perspective; `blur` as for the sky. Waves smaller than a pixel spread
// it upwards: `upright` is a standard deviation of its direction, and the picture is averaged along it.
vec3 mirrored(vec3 from, vec3 direction, vec3 upright, float blur)
{
    float gone = FIRST_STEP, before = 0.0, hit = -1.0, seen_hit = -1.0;
    vec4 clip_from = to_clip * vec4(from, 1.0), clip_direction = to_clip * vec4(direction, 0.0);
    for (int i = 0; i < MARCH; ++i) {
        vec3 p = from + direction * gone;
#if MATERIALS > 1
        vec4 clip = clip_from + gone * clip_direction;
        vec3 at = picture_place(clip);
        // Both are on one ray from the eye, so distances are as depths along the axis.
        float depth = axial_depth(at.xy);
        float behind = length(p) * (1.0 - depth / clip.w);
        // Where the depth buffer is behind the ray it is unobstructed, whatever the coarser height map says.
        bool open = at.z > 0.0 && behind <= 0.0;
        // What stands before the water hides what is behind it.
        if (at.z > 0.0 && depth > clip_from.w && behind > 0.0 && behind < max(THICK, THICK_STEPS * (gone - before))) {
            seen_hit = gone;
            break;
        }
#else
        bool open = gone < 2.0 * near_map.w;
#endif
        if (!open && is_mapped(p.xy) && p.z < relief_at(p.xy) - SUNK) {
            hit = 0.5 * (before + gone);
            break;
        }
        before = gone;
        gone = gone * STRIDE + FIRST_STEP;
    }
#if MATERIALS > 1
    float near_end = before, far_end = max(seen_hit, before);
    for (int i = 0; i < HALVINGS; ++i) {
        float middle = 0.5 * (near_end + far_end);
        vec4 clip = clip_from + middle * clip_direction;
        bool passed = clip.w > axial_depth(picture_place(clip).xy);
        far_end = passed ? middle : far_end;
        near_end = passed ? near_end : middle;
    }
    if (seen_hit > 0.0) hit = far_end;
#endif
    vec3 sky = through_air(mirrored_sky(direction, blur), from), mean = sky;
    if (hit >= 0.0) {
        vec3 p = from + direction * hit;
        vec3 at = picture_place(p);
        float off = abs(length(scene_position(at.xy)) - length(p)) / length(p);
        float known = seen_hit > 0.0 ? at.z : at.z * (1.0 - smoothstep(0.05, 0.2, off));
        mean = mix(seen_hit > 0.0 ? sky : guessed_ground(p), textureLod(scene, at.xy, 0.0).rgb, known);
    }
#if MATERIALS > 1
    vec4 sum = vec4(0.0);
    // In [-0.5, 0.5), or the taps would draw stripes.
    float between = interleaved_noise((clip_from.xy / clip_from.w * 0.5 + 0.5) * view_range.zw) - 0.5;
    // Slopes across the line of sight turn a ray by the sine of the grazing angle over those along it.
    vec2 aside = vec2(-direction.y, direction.x) * (1.7 * max(direction.z, ASIDE) * length(upright) / max(length(direction.xy), 1e-3));
    for (int i = -TAPS; i <= TAPS; ++i) {
        float s = TAP * (float(i) + between), t = 2.0 * fract(0.618034 * float(i) + between + 0.5) - 1.0;
        vec3 towards = direction + s * upright + vec3(t * aside, 0.0);
        vec3 at = picture_place(from + towards * (hit < 0.0 ? FAR_OFF : s < 0.0 ? hit : hit + hit * hit / OVERLOOKED));
        // Not what stands before the water. What is unknown is taken to be as along the ray itself.
        float seen = at.z * step(0.0, towards.z) * step(length(from), length(scene_position(at.xy)));
        vec3 bright = min(textureLod(scene, at.xy, 0.0).rgb, sky + BRIGHTEST * sun_light.rgb);
        bright = mix(bright, sky, blur * step(0.9999999, textureLod(scene_depth, at.xy, 0.0).r));
        sum += exp(-0.5 * s * s) * vec4(mix(mean, bright, seen), 1.0);
    }
    mean = sum.rgb / sum.w;
#endif
    return mean;
}
