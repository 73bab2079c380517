// What vectors paint on the terrain, from tiles of texels: render/appearance.py.
//   APPEARANCE         most samples along a pixel's footprint
//   APPEARANCE_LEVELS  number of levels
//   APPEARANCE_FILTER  whether tiles filter the ground's colour
uniform usampler2DArray appearance_pages; // by level: x: slot + 1 and 2^16 times its level, or 0; y: one colour
uniform sampler2DArray appearance_texels; // rgb: √albedo times the share; a: share that is painted; row 0 north
#if APPEARANCE_FILTER
uniform sampler2DArray appearance_filters; // rgb: how much of the ground's red, green and blue is seen; a: is lit
uniform float appearance_exposure;         // of the picture
#include "render/tone.glsl"
#endif
float appearance_unlit = 0.0; // share of the last place or pixel whose colours light and haze leave
uniform ivec2 appearance_tile[APPEARANCE_LEVELS]; // tile of the eye: column, row
uniform vec2 appearance_place[APPEARANCE_LEVELS]; // place of the eye in it, 0 … 1
uniform float appearance_width;                   // of a tile of level 0, m

const int PAGES = 64;              // tiles along the side of a page table
const int READ = 3 * PAGES / 8 - 1; // tiles from the eye's that are read: tables are made when it has moved on
const float TEXELS = 192.0;        // along the side of a tile, of which INNER are its own
const float INNER = TEXELS - 2.0;
const float TEXEL_PIXELS = 1.1;    // px, greatest width of a texel
const int LEVELS_READ = APPEARANCE > 2 ? 2 : 1;
const float BLENDED = 0.35;        // of a level, over which it is blended with the one above
const float LEAST_SINE = 0.02;     // of the angle at which ground is seen

// What is painted at a place (m from the eye), at a level or at the finest one that is there.
//   through  how much of the ground's red, green and blue is seen
vec4 painted_at(vec2 place, int level, out vec3 through)
{
    ivec2 tile = appearance_tile[level]
        + ivec2(floor(appearance_place[level] + place * exp2(float(level)) / appearance_width));
    uvec2 page = texelFetch(appearance_pages, ivec3(tile & (PAGES - 1), level), 0).xy;
    int own = int(page.x >> 16u);
    // The same tile for all that rounds to its borders: texels of the neighbours lie around it.
    ivec2 apart = (tile >> (level - own)) - appearance_tile[own];
    vec2 at = appearance_place[own] + place * exp2(float(own)) / appearance_width - vec2(apart);
    vec2 uv = (vec2(at.x, 1.0 - at.y) * INNER + 1.0) / TEXELS;
    vec3 slot = vec3(uv, float(max(int(page.x & 0xFFFFu) - 1, 0)));
    vec4 texel = textureLod(appearance_texels, slot, 0.0);
    vec4 found = page.x == 0u ? unpackUnorm4x8(page.y) : texel;
    through = vec3(1.0 - found.a);
#if APPEARANCE_FILTER
    vec4 filtered = textureLod(appearance_filters, slot, 0.0);
    through = page.x == 0u ? through : filtered.rgb;
    appearance_unlit = page.x == 0u ? 0.0 : 1.0 - filtered.a;
#endif
    return found;
}

// The level of texels of a width (m) at a place (m from the eye), or one that is read there.
float painted_level(vec2 place, float texel)
{
    float farthest = max(max(abs(place.x), abs(place.y)), 1e-3);
    float nearest = floor(log2(float(READ) * appearance_width / farthest));
    return clamp(min(log2(appearance_width / (INNER * texel)), nearest), 0.0, float(APPEARANCE_LEVELS - 1));
}

// What is painted about a place (m from the eye), on texels of a width (m): rgb: albedo; a: share.
vec4 painted_about(vec2 place, float texel, out vec3 through)
{
    vec4 found = painted_at(place, int(painted_level(place, texel)), through);
    vec3 root = found.rgb / max(found.a, 1e-4);
    return vec4(root * root, found.a);
}

// What is painted on the footprint of a pixel: rgb: albedo; a: share.
//   n      normal of the ground
//   pixel  rad
vec4 painted(vec3 position, vec3 n, float pixel, out vec3 through)
{
    float distance = length(position);
    vec3 seen = position / distance;
    float sine = max(abs(dot(seen, n)), LEAST_SINE);
    // The axes of the footprint on the ground: up the picture, and beside that.
    vec3 upward = n + seen * sine;
    upward *= inversesqrt(max(dot(upward, upward), 1e-6));
    vec2 longest = distance * pixel * (upward + seen * dot(upward, n) / sine).xy;
    float least = distance * pixel;
    float ratio = length(longest) / least;
    int taps = clamp(int(ceil(ratio - 0.01)), 1, APPEARANCE);
    float texel = TEXEL_PIXELS * least * max(ratio / float(APPEARANCE), 1.0);
    float level = painted_level(position.xy, texel);
    int finer = int(ceil(level));
    // Share of the level above; as with mipmaps, low qualities do not blend.
    float coarser = LEVELS_READ > 1 ? max(1.0 - (level - float(finer) + 1.0) / BLENDED, 0.0) : 0.0;
    vec4 sum = vec4(0.0);
    through = vec3(0.0);
    float unlit = 0.0;
    for (int k = 0; k < LEVELS_READ; ++k) {
        float weight = k == 0 ? 1.0 - coarser : coarser;
        if (weight == 0.0) break;
        for (int tap = 0; tap < taps; ++tap) {
            vec3 seen_through;
            vec2 place = position.xy + longest * ((float(tap) + 0.5) / float(taps) - 0.5);
            sum += weight * painted_at(place, finer - k, seen_through);
            through += weight / float(taps) * seen_through;
            unlit += weight / float(taps) * appearance_unlit;
        }
    }
    appearance_unlit = unlit;
    vec3 root = sum.rgb / max(sum.a, 1e-4);
    return vec4(root * root, sum.a / float(taps));
}
