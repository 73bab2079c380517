#version 430 core
// The part of the drawn ground that a piece of a road covers, blended over the shaded ground by the share of a pixel.
//   FAR  1: lit at the corners of its box
#include "render/built.glsl"
#include "render/road_strip.glsl"

uniform sampler2D gbuffer_depth;

flat in vec4 start, end, left, width, look;
#if FAR
in vec3 seen_light;
#endif
out vec4 radiance;

void main()
{
    vec2 size = vec2(textureSize(gbuffer_depth, 0));
    float depth = texelFetch(gbuffer_depth, ivec2(gl_FragCoord.xy), 0).r;
    vec4 unprojected = from_clip * vec4(vec3(gl_FragCoord.xy / size, depth) * 2.0 - 1.0, 1.0);
    vec3 position = unprojected.xyz / unprojected.w;

    // Share of the piece, by the distances from the lines across its ends, which neighbours share.
    vec2 from_start = position.xy - start.xy, from_end = position.xy - end.xy;
    float ahead = dot(from_start, vec2(left.y, -left.x)), behind = dot(from_end, vec2(left.w, -left.z));
    float before = look.z == CUT ? 0.0 : -OVERLAP, after = look.w == CUT ? 0.0 : OVERLAP;
    bool is_inside = (ahead >= before || look.z == ROUND) && (behind < after || look.w == ROUND);
    float t = clamp(ahead / max(ahead - behind, 1e-3), 0.0, 1.0);
    vec3 axis = mix(start.xyz, end.xyz, t);
    vec2 aside = mix(left.xy, left.zw, t);
    float across = dot(position.xy - axis.xy, aside);
    float half_width = mix(width.x, width.y, t);
    float slope = (end.z - start.z) / max(end.w - start.w, 1e-3), fall = across > 0.0 ? width.z : -width.w;
    vec2 on = vec2(aside.y, -aside.x);
    vec3 n = normalize(vec3(-slope * on - fall * aside, 1.0));
    float distance = length(position);
    // Width of a pixel along and across the road, on its plane.
    vec3 seen = position / distance;
    float rise = max(abs(dot(seen, n)), 0.02);
    vec2 flat_view = seen.xy / max(length(seen.xy), 1e-4);
    float toward = dot(flat_view, aside);
    float pixel = distance * trees.z;
    vec2 wide = pixel * sqrt(vec2(1.0) + (1.0 / (rise * rise) - 1.0) * vec2(1.0 - toward * toward, toward * toward));
    float offset = across;
    if (look.z == ROUND && ahead < 0.0) offset = length(from_start);
    if (look.w == ROUND && behind > 0.0) offset = length(from_end);
    float share = covered(offset, half_width, wide.y);
    float away = abs(position.z - axis.z - fall * across) / strip_reach(distance);
    share *= 1.0 - smoothstep(0.7, 1.0, away);
    if (!is_inside || depth >= 1.0 || share <= 0.0) discard;
#if FAR
    radiance = vec4(seen_light, share);
#else
    vec2 uv = vec2(mix(start.w, end.w, t), across + half_width);
    radiance = vec4(built_radiance(position, n, vec4(0.0), 1.0, look.xy, uv, wide), share);
#endif
}
