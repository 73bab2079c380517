// Uniforms and functions shared by all passes of a frame. Positions are metres from the eye, x east, y north, z up.
#define PI 3.14159265358979

// LIGHT_MAPS: 2: near and far map of the light on the terrain; 3: another one close to the eye.
#ifndef LIGHT_MAPS
#define LIGHT_MAPS 2
#endif

layout(std140) uniform Frame {
    mat4 to_clip;      // relative position → clip space
    mat4 from_clip;
    vec4 eye;          // xy: m, modulo NOISE_PERIOD of render/targets.py; z: m above sea level; w: elevation of the tree line, m
    vec4 to_sun;       // xyz: unit vector; w: unused
    vec4 sun_light;    // rgb: irradiance on a surface facing the sun; w: share of air light lost in shadow
    vec4 sky_light[9]; // rgb: irradiance from sky and ground, spherical harmonics, cosine lobe folded in
    vec4 haze;         // rgb: extinction by aerosols at base height, 1/m; w: their scale height, m
    vec4 air;          // rgb: by molecules, 1/m; w: their scale height, m
    vec4 view_range;        // x: draw distance, m; y: base height of the haze, m; zw: framebuffer size, px
    vec4 near_map;     // xy: south-west corner relative to the eye, m; z: 1/width, 1/m; w: texel, m
    vec4 far_map;
    vec4 close_map;
    vec4 near_window;  // west, south, east, north of the visible rectangle of the near map, relative to the eye, m
    vec4 far_window;
    vec4 close_window;
    vec4 map_strength; // opacity 0..1 of the maps in their windows; x: near, y: far, z: close
    mat4 to_shade[4];  // relative position → clip space of the tree shadow maps: near, far, previous near, previous far
    vec4 shade_share;  // x: cross-fade 0..1 from the previous to the near map; y: the same of the far one
    vec4 trees;        // x: distance beyond which forest floor is drawn as canopy, m; y: aridity 0..1; z: pixel, rad; w: draw distance of plants, m, or 0
};

// Interleaved gradient noise (Jimenez 2014) of a pixel, 0 ... 1: neighbours differ evenly.
float interleaved_noise(vec2 pixel) { return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715)))); }

uniform sampler2D sky_view;    // by direction: lower half in-scattered light, upper half sky (render/sky.py)
uniform sampler2D near_light;  // r: sun visibility, g: sky visibility, b: terrain height, m, a: unused
uniform sampler2D far_light;
uniform sampler2D close_light;

// Irradiance from sky and ground on a surface of normal n (Ramamoorthi & Hanrahan 2001).
vec3 sky_irradiance(vec3 n)
{
    return max(vec3(0.0),
        sky_light[0].rgb + sky_light[1].rgb * n.y + sky_light[2].rgb * n.z + sky_light[3].rgb * n.x
        + sky_light[4].rgb * (n.x * n.y) + sky_light[5].rgb * (n.y * n.z)
        + sky_light[6].rgb * (3.0 * n.z * n.z - 1.0) + sky_light[7].rgb * (n.x * n.z)
        + sky_light[8].rgb * (n.x * n.x - n.y * n.y));
}

// Texture coordinates of a direction in a half of sky_view: 0 in-scattered light, 1 sky above the horizon.
vec2 sky_place(vec3 direction, float half_)
{
    float elevation = asin(clamp(direction.z, -1.0, 1.0)) / (0.5 * PI);
    vec2 flat_view = direction.xy * inversesqrt(max(dot(direction.xy, direction.xy), 1e-12));
    vec2 flat_sun = to_sun.xy * inversesqrt(max(dot(to_sun.xy, to_sun.xy), 1e-12));
    float around = sqrt(acos(clamp(dot(flat_view, flat_sun), -1.0, 1.0)) / PI);
    float rise = sqrt(abs(elevation));
    rise = half_ > 0.5 ? (elevation > 0.0 ? rise : 0.0) : 0.5 + 0.5 * sign(elevation) * rise;
    vec2 size = vec2(textureSize(sky_view, 0)) * vec2(1.0, 0.5);
    vec2 at = (vec2(around, rise) * (size - 1.0) + 0.5) / size;
    return vec2(at.x, 0.5 * (at.y + half_));
}

// Radiance of the clear sky in a direction at or above the horizon.
vec3 clear_sky(vec3 direction) { return textureLod(sky_view, sky_place(direction, 1.0), 0.0).rgb; }

// In-scattered light along a line of sight, divided by the opacity of the air.
vec3 air_light(vec3 direction) { return textureLod(sky_view, sky_place(direction, 0.0), 0.0).rgb; }

// Transmittance between the eye and a relative position: Beer's law with exponential density profiles of aerosols and
// molecules.
vec3 clear_air(vec3 position)
{
    float above = max(eye.z - view_range.y, 0.0);
    float rise = max(position.z, -above) / haze.w;
    float mean_haze = exp(-above / haze.w) * (abs(rise) < 1e-2 ? 1.0 - 0.5 * rise : (1.0 - exp(-rise)) / rise);
    float mean_air = exp(-(above + 0.5 * position.z) / air.w);
    return exp(-length(position) * (haze.rgb * mean_haze + air.rgb * mean_air));
}

// Opacity of a map at a position: fades out inside the border of its window.
float window_share(vec2 place, vec4 window, float per_width, float soft)
{
    vec2 room = min(place - window.xy, window.zw - place);
    return smoothstep(0.01, soft, min(room.x, room.y) * per_width);
}

vec4 ground_light(vec2 place)
{
    vec2 near_uv = (place - near_map.xy) * near_map.z;
    vec2 far_uv = (place - far_map.xy) * far_map.z;
    float near_share = map_strength.x * window_share(place, near_window, near_map.z, 0.05);
    float far_share = map_strength.y * window_share(place, far_window, far_map.z, 0.06);
    vec4 wide = mix(vec4(1.0), textureLod(far_light, far_uv, 0.0), far_share);
    vec4 light = mix(wide, textureLod(near_light, near_uv, 0.0), near_share);
#if LIGHT_MAPS > 2
    float close_share = map_strength.z * window_share(place, close_window, close_map.z, 0.08);
    light = mix(light, textureLod(close_light, (place - close_map.xy) * close_map.z, 0.0), close_share);
#endif
    return light;
}

const vec2 SHADED_AIR_AT = vec2(0.5, 0.85); // fractions of a line of sight at which shadow of the air is sampled
const float SHADED_AIR_HEIGHT = 500.0;      // m over shaded ground at which the air is shaded by 1/e

// Sunlight of the air at a relative position, 0 ... 1.
float lit_air(vec3 place)
{
    vec4 light = ground_light(place.xy);
    return 1.0 - (1.0 - light.r) * exp(-max(eye.z + place.z - light.b, 0.0) / SHADED_AIR_HEIGHT);
}

// Aerial perspective: extinction and in-scattering between the eye and a relative position. Radiance fades into air
// light at the draw distance. With three light maps, air above shaded terrain is dimmer.
vec3 through_air(vec3 radiance, vec3 position)
{
    vec3 clear = clear_air(position) * (1.0 - smoothstep(0.75, 0.98, length(position.xy) / view_range.x));
    vec3 air = air_light(position * inversesqrt(max(dot(position, position), 1e-6)));
#if LIGHT_MAPS > 2
    float lit = lit_air(SHADED_AIR_AT.x * position) + lit_air(SHADED_AIR_AT.y * position);
    air *= 1.0 - sun_light.w * (1.0 - 0.5 * lit);
#endif
    return mix(air, radiance, clear);
}
