#version 430 core
// Water surface: meshes wider than the water, clipped by the banks. Displayed ground may be slightly too high, so the depth
// of water is that of the point where its line of sight meets ground higher by that error: water wins against it. There
// it ends at its shore instead of at the banks.
#include "render/frame.glsl"
#include "render/water_strip.glsl"

uniform vec3 anchor; // origin of all positions, relative to the eye, m
uniform float lift;  // error of the displayed ground's height seen from the side, per metre of distance

in vec3 local_position;  // m from the anchor; of the sea in draw distances
in vec4 flow_frame; // x: m across, from the centreline; y: m along; zw: unit vector downstream
in vec2 shore;  // x: m from the shore, negative in the bank; y: extent of the mesh into the bank, m
in vec4 stream_params; // x: mid-stream speed, m/s; y: slope; z: visible share; w: half width, 0 for a lake, -1 for the sea

out vec3 position;
out vec4 flow;
out vec4 stream;    // stream_params
out float wet_room; // m from the edge; no water below 0
out float nearer;   // relative depth offset against the ground
out float coverage; // of the drawn strip by water

const float BANK = 0.25;      // m of bank over which clipping replaces the shore test
const float STEEPEST = 0.25;  // smallest horizontal share of a line of sight
const float FLATTEST = 0.035; // tangent of the grazing angle without an offset
const float OVER = 3e-5;      // relative depth offset of streams over lakes

vec2 in_picture(vec4 clip) { return clip.xy / clip.w * 0.5 * view_range.zw; }

void main()
{
    bool sea = stream_params.w < 0.0;
    position = anchor + local_position * (sea ? view_range.x : 1.0);
    float distance = length(position);
    float rise = lift * distance / max(length(position.xy) / distance, STEEPEST);
    nearer = min(rise / max(abs(position.z), FLATTEST * distance), 0.5) + (stream_params.w > 0.0 ? OVER : 0.0);
    // Without a shore to end at, the sea ends where it meets the drawn ground.
    if (sea) nearer = 0.0;
    wet_room = sea ? 1.0 : shore.x + max(1.0 - rise / BANK, 0.0) * shore.y;
    flow = flow_frame;
    stream = stream_params;
    coverage = 1.0;
    gl_Position = to_clip * vec4(position, 1.0);
    vec4 before = to_clip * vec4(position * (1.0 - nearer), 1.0);
    if (before.w > 0.0) gl_Position.z = before.z / before.w * gl_Position.w;
    if (sea) gl_Position.z = min(gl_Position.z, 0.9999999 * gl_Position.w);

    vec3 right = vec3(flow_frame.w, -flow_frame.z, 0.0);
    vec4 centre = to_clip * vec4(position - flow_frame.x * right, 1.0);
    vec4 edge = to_clip * vec4(position + (stream_params.w - flow_frame.x) * right, 1.0);
    if (stream_params.w > 0.0 && min(min(centre.w, edge.w), gl_Position.w) > stream_params.w) {
        vec4 step_on = to_clip * vec4(flow_frame.zw, 0.0, 0.0);
        vec2 along = (step_on.xy * centre.w - centre.xy * step_on.w) * view_range.zw;
        vec3 drawn = widened(in_picture(gl_Position), in_picture(centre), in_picture(edge), along);
        gl_Position.xy = drawn.xy / (0.5 * view_range.zw) * gl_Position.w;
        coverage = drawn.z;
    }
}
