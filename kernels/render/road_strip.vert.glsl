#version 430 core
// A corner of the box of a piece of a road. Corners are counted by end, side and height.
//   FAR  1: lit here
#include "render/built.glsl"
#include "render/road_strip.glsl"

uniform vec3 anchor; // of all pieces, relative to the eye, m

in vec4 piece_start; // xyz: m from the anchor; w: m along the road
in vec4 piece_end;
in vec4 piece_left;  // xy: unit normal to the left at the start, zw: at the end
in vec4 piece_width; // half widths at start and end, m; crossfall to the left and to the right
in vec4 piece_look;  // x: layer; y: m between railway tracks; zw: kinds of the ends

flat out vec4 start, end, left, width, look;
#if FAR
out vec3 seen_light; // radiance
#endif

void main()
{
    start = vec4(piece_start.xyz + anchor, piece_start.w);
    end = vec4(piece_end.xyz + anchor, piece_end.w);
    left = piece_left;
    width = piece_width;
    look = piece_look;
    bool last = (gl_VertexID & 1) != 0;
    vec3 at = last ? end.xyz : start.xyz;
    vec2 aside = last ? left.zw : left.xy;
    vec2 ahead = vec2(aside.y, -aside.x) * (last ? 1.0 : -1.0);
    float distance = length(at);
    float half_width = last ? width.y : width.x;
#if FAR
    vec3 slope = vec3(vec2(aside.y, -aside.x) * (start.z - end.z) / max(end.w - start.w, 1e-3), 1.0);
    seen_light = built_radiance(at, normalize(slope), vec4(0.0), 1.0, vec2(look.x, 0.0), vec2(0.0), vec2(0.0));
#endif
    float margin = 2.0 * trees.z * distance;
    float kind = last ? look.w : look.z;
    float longer = kind == ROUND ? half_width + margin : kind == LONGER ? OVERLAP : 0.0;
    at.xy += aside * ((gl_VertexID & 2) != 0 ? half_width + margin : -half_width - margin) + ahead * longer;
    float up = strip_reach(distance) + half_width * max(abs(width.z), abs(width.w));
    at.z += (gl_VertexID & 4) != 0 ? up : -up;
    gl_Position = to_clip * vec4(at, 1.0);
}
