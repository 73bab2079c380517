#version 430 core
// Water surface: reflection of sky, banks and sun, refracted bed, foam, and soft shores.
#if MATERIALS == 1
#define WAVES 1
#else
#define WAVES 4
#endif
#include "render/frame.glsl"
#include "render/surface.glsl"
#include "render/water_mirror.glsl"
#include "render/shade.glsl"
#include "render/water_optics.glsl"
#include "render/water_waves.glsl"
#include "render/water_foam.glsl"

uniform float clock; // s
uniform vec2 wind;   // m/s

in vec3 position;
in vec4 flow;
in vec4 stream;
in float wet_room;
in float nearer;
in float coverage;
out vec4 radiance;

// Of lakes and streams with yellow substance and a little silt, 1/m; pure water absorbs 0.28, 0.056, 0.009 (Pope & Fry 1997).
const vec3 FRESH_ABSORPTION = vec3(0.48, 0.19, 0.34);
const vec3 FRESH_BACKSCATTER = vec3(0.006, 0.0085, 0.0078);
// Of a coast: clearer and bluer, with a little yellow substance and plankton.
const vec3 SEA_ABSORPTION = vec3(0.33, 0.075, 0.048);
const vec3 SEA_BACKSCATTER = vec3(0.0035, 0.0052, 0.0062);
const float FOAM_ALBEDO = 0.62;
const float SHELTER = 0.42;          // inland wind over that of open sea
const float CALM = 0.0003;           // slope² of water without wind
const float FETCH = 2.0;             // fetch of a wind from anywhere, over the distance from the shore
const vec3 LANE = vec3(1100.0, 300.0, 24.0); // m, of ruffled patches: periods along and across the wind, soft borders
const float RIPPLE = 0.12;           // longest ripple of a stream, over its half width
const float ACROSS_VIEW = 0.8;       // exponent of the cosine by which a pixel's footprint on the water grows
const float UPWIND[4] = float[](40.0, 150.0, 500.0, 1600.0); // m, where land shelters the sea
const float SHELTERED = 0.1;         // share of its slope² then
const float CLEAREST = 60.0;         // m of depth beyond which no bed is seen
const float FOAM_TEXELS = 512.0;     // of the noise texture, each side
const float FROTH = 9.3;             // frequency of froth over that of foam patches
const float SWELL_PERIOD = 4.3;      // s, of swell at shores
const float SOFT_SHORE = 0.07;       // m of depth over which alpha rises
const float SOFT_PIXELS = 0.15;      // and in pixels on the sea, whose shore nothing else smooths
const float SURF_PERIOD = 7.0;       // s, of the waves that break at a coast
const float GUSTS = 6144.0;          // m, period of the sea's wide gusts
const vec2 BLUR = vec2(0.03, 0.09);  // standard deviations of slope between which the sea stops to mirror single clouds
const float UNSEEN = 0.9999999;      // depth buffer without ground

// Slope² of waves under a wind (m/s), both axes together (Cox & Munk 1954).
float wind_roughness(float speed) { return 0.00512 * speed; }

// Slope² of a stream's ripples: grows with speed and slope.
float stream_roughness(float speed, float fall) { return 0.001 + 0.0045 * speed + 0.03 * smoothstep(0.01, 0.1, fall); }

void main()
{
    float edge = wet_room / max(fwidth(wet_room), 1e-4);
    if (wet_room < 0.0) discard;
    float distance = length(position);
    vec3 to_eye = -position / distance;
    vec2 tilt = -stream.y * flow.zw; // of a sloping stream's surface
    float grazing = max(dot(to_eye, normalize(vec3(-tilt, 1.0))), 0.02);
    vec2 uv = gl_FragCoord.xy / view_range.zw;
    float pixel = distance * trees.z * pow(grazing, -ACROSS_VIEW);
    bool lake = stream.w <= 0.0, sea = stream.w < 0.0;

    // Gusts and slicks, elongated along a stream and advected by it.
    float across = flow.x / max(stream.w, 0.1);
    float speed = stream.x * (0.15 + 0.85 * stream_profile(across));
    vec2 downwind = wind / max(length(wind), 1e-3), adrift = position.xy + eye.xy - wind * clock * 0.5;
    vec2 drift = sea ? adrift / 512.0 : lake ? vec2(dot(adrift, downwind), dot(adrift, vec2(-downwind.y, downwind.x))) / LANE.xy
               : vec2(flow.x / 24.0, (flow.y - stream.x * clock * 0.7) / 190.0);
    vec4 patches = textureLod(noise_field, drift, log2(max(sea ? pixel : lake ? pixel + LANE.z : 8.0 * pixel, 0.01)));
    float gust = smoothstep(-0.7, 0.9, patches.x), exposed = 1.0;
    if (sea) {
        // Seen from high up the patches of a lake would repeat.
        vec2 wide_at = mat2(0.8, 0.6, -0.6, 0.8) * (position.xy + eye.xy - wind * clock) / GUSTS;
        float wide = textureLod(noise_field, wide_at, log2(max(pixel * 512.0 / GUSTS, 0.01))).x;
        gust = smoothstep(-0.9, 0.9, wide + 0.35 * patches.x / (1.0 + pixel / 4.0));
        for (int i = 0; i < 4; ++i) exposed -= (1.0 - SHELTERED) / 4.0 * land_at(position - vec3(UPWIND[i] * downwind, 0.0));
    }
    float inland = SHELTER * length(wind);
    float longest = sea ? -1.0 : lake ? longest_wave(inland, FETCH * wet_room) : RIPPLE * stream.w;
    float roughness = CALM + (sea ? wind_roughness(length(wind)) * (0.6 + 0.8 * gust) * exposed
        : lake ? wind_roughness(inland) * mix(0.03, 1.5, smoothstep(-0.5, 0.7, patches.x))
               : stream_roughness(speed, stream.y) * (0.45 + 1.1 * gust));
    float time = clock / RENEWAL + 0.8 * patches.y;
    Waves waves = waves_at(position.xy, flow.zw * speed, pixel, roughness, time, longest);
    // Facets that lean away from a low eye are hidden behind others: the least slope seen is softened.
    vec2 to_eye_flat = to_eye.xy / max(length(to_eye.xy), 1e-4);
    float met = grazing * inversesqrt(1.0 - min(grazing * grazing, 0.99)) - dot(waves.slope, to_eye_flat);
    waves.slope -= to_eye_flat * (0.5 * (sqrt(met * met + 4.0 * waves.resolved) - met));

    // The bed, where the refracted ray meets a level bed of the depth behind the pixel.
    float rise = nearer * abs(position.z);
    vec3 behind = scene_position(uv);
    float depth = max(position.z + dot(tilt, behind.xy - position.xy) - behind.z + rise, 0.0);
    float up = refracted_cosine(grazing);
    if (sea && textureLod(scene_depth, uv, 0.0).r > UNSEEN) depth = CLEAREST;
    float soft = smoothstep(0.0, sea ? max(SOFT_SHORE, SOFT_PIXELS * pixel) : SOFT_SHORE, depth);
    float shallow = depth - rise;
    vec2 bed_uv = uv;
#if MATERIALS > 1
    vec3 refracted = vec3(-to_eye.xy / WATER_INDEX + 0.25 * waves.slope, -up);
    vec3 bent = picture_place(position + refracted * (min(depth, 8.0) / up));
    vec3 bent_behind = scene_position(bent.xy);
    float bent_depth = position.z + dot(tilt, bent_behind.xy - position.xy) - bent_behind.z + rise;
    // Geometry in front of the surface must not be refracted.
    bool straight = bent_depth < 0.0 || bent.z <= 0.0 || length(bent_behind) < distance;
    bed_uv = straight ? uv : bent.xy;
    depth = straight ? depth : bent_depth;
#endif
    vec3 bed = textureLod(scene, bed_uv, 0.0).rgb;

    vec4 light = ground_light(position.xy);
    float sun = light.r * cloud_shadow(position);
#if MATERIALS > 1
    sun *= tree_shade(position, vec3(0.0, 0.0, 1.0));
#endif
    vec3 incoming = sun_light.rgb * max(to_sun.z, 0.0) * sun + sky_irradiance(vec3(0.0, 0.0, 1.0)) * light.g;
    vec3 absorption = sea ? SEA_ABSORPTION : FRESH_ABSORPTION;
    vec3 backscatter = sea ? SEA_BACKSCATTER : FRESH_BACKSCATTER;
    vec3 clear = let_through(absorption + backscatter, min(depth, CLEAREST), up, refracted_cosine(max(to_sun.z, 0.2)));
    vec3 air = through_air(vec3(0.0), position);
    vec3 body = through_air((1.0 - clear) * deep_colour(absorption, backscatter) * incoming / PI, position);
    body += clear * max(bed - air, 0.0);

    // Visible facets lean towards the eye, so rough water reflects higher parts of the sky.
    float spread = sqrt(waves.variance);
    float lean = seen_slope(grazing, spread);
    vec2 slope = waves.slope + tilt;
    vec3 normal = normalize(vec3(-slope + to_eye_flat * lean, 1.0));
    vec3 back = reflect(-to_eye, normal);
    back.z = max(abs(back.z), 0.012);
    float cosine = max(dot(normalize(vec3(-slope, 1.0)), to_eye), 0.02);
    float share = mirrored_share(cosine, spread);
#if MATERIALS == 1
    float blur = 1.0; // waves are not resolved
#else
    float blur = sea ? smoothstep(BLUR.x, BLUR.y, spread) : 0.0;
#endif
    vec3 glint = sun_light.rgb * min(glitter(to_eye, to_sun.xyz, slope, max(spread, 0.03)), 12.0) * sun;
    vec3 upright = 2.0 * seen_spread(grazing, spread, lean) * vec3(to_eye_flat * back.z, length(back.xy));
    vec3 surface = mix(body, mirrored(position, normalize(back), upright, blur), share) + through_air(glint, position) - air;

    // Foam: streaks along a stream, lines along a shore; both made of froth.
    float beat = sin(6.2831853 * (clock / SWELL_PERIOD + patches.z + 0.7 * patches.w));
    float fine = clamp(0.12 / max(pixel, 0.01), 0.0, 1.0); // visibility of a shoreline at this pixel size
    float shoal = shore_foam(max(shallow, 0.0), beat, lake ? 0.14 : 0.08) * fine * (lake ? 0.15 : 0.03) * (0.2 + gust);
    float amount = shoal + (lake ? 0.0 : stream_foam(stream.y, across));
    if (sea) {
        float passed = waves_to_shore(shallow, SURF_PERIOD) + clock / SURF_PERIOD + 0.6 * patches.y;
        float strength = length(wind), seen = 1.0 - smoothstep(0.5, 4.0, pixel);
        amount = surf_foam(max(shallow, 0.0), surf_height(strength), passed, seen) * (0.7 + 0.6 * gust) + whitecaps(strength) * 8.0 * gust * max(patches.z, 0.0) * (1.0 - smoothstep(0.5, 2.5, pixel));
    }
#if MATERIALS == 1
    float foam = clamp(amount, 0.0, 0.8), heaped = 0.75;
#else
    vec2 grain_at = lake ? (position.xy + eye.xy) / 64.0 : vec2(flow.x / 23.0, (flow.y - stream.x * clock) / 140.0);
    grain_at += waves.slope * 0.008;
    if (sea) grain_at += 0.25 * patches.zw; // or whitecaps would repeat
    float sized = log2(max(pixel * FOAM_TEXELS / (lake ? 64.0 : 23.0), 1e-3));
    vec4 grain = textureLod(noise_field, grain_at, sized);
    vec4 froth = textureLod(noise_field, grain_at * FROTH, sized + log2(FROTH));
    float lost = 0.5 * smoothstep(2.0, 9.0, sized + 2.0);
    vec2 web_at = (lake ? position.xy + eye.xy : vec2(flow.x, flow.y - stream.x * clock)) / 8.0 + waves.slope * 0.02;
    float web = textureLod(noise_field, web_at, sized + 1.5).z;
    float foam = foam_cover(foam_share(0.7 * grain.z + 0.7 * froth.x, amount, lost), amount, web);
    // Shading of heaped bubbles.
    float heaped = clamp(0.75 + 0.22 * froth.z + 0.3 * web, 0.35, 1.1);
#endif
    surface = mix(surface, through_air(FOAM_ALBEDO / PI * heaped * incoming, position), foam);

    radiance = vec4(surface, soft * clamp(edge + 0.5, 0.0, 1.0) * coverage * stream.z);
}
