#version 430 core
// A water's surface: sheets and strips wider than the water; the banks cut them. The ground may be drawn a little too
// high, so water wins over ground that stands over it by no more than that: it is drawn where it is, with the depth
// of the place where its line of sight meets the higher ground. There it ends at its shore instead of at the banks.
#include "render/frame.glsl"
#include "render/water_strip.glsl"

uniform vec3 anchor; // of all positions, relative to the eye, m
uniform float lift;  // how much too high the ground may be as seen sideways, m for each metre of distance

in vec3 local_position;  // m from the anchor
in vec4 flow_frame; // x: m across, from the centreline; y: m along; zw: unit vector downstream
in vec2 shore;  // x: m from the shore, negative in the bank; y: how far into the bank the surface goes, m
in vec4 stream_params; // x: speed in the middle, m/s; y: fall, m a metre; z: how much of it is shown; w: half width of a stream, 0 of a lake

out vec3 position;
out vec4 flow;
out vec4 stream;    // stream_params
out float wet_room; // m; no water below 0
out float nearer;   // share of the distance by which it wins over the ground
out float coverage; // of what is drawn by the water

const float BANK = 1.0;       // m over which the banks hide
const float STEEPEST = 0.25;  // how sideways water is seen at least
const float FLATTEST = 0.035; // tangent of the angle from which on it is seen too flatly to win
const float OVER = 3e-5;      // share of the distance by which a stream lies over a lake

vec2 in_picture(vec4 clip) { return clip.xy / clip.w * 0.5 * reach.zw; }

void main()
{
    position = anchor + local_position;
    float distance = length(position);
    float rise = lift * distance / max(length(position.xy) / distance, STEEPEST);
    nearer = min(rise / max(abs(position.z), FLATTEST * distance), 0.5) + (stream_params.w > 0.0 ? OVER : 0.0);
    wet_room = shore.x + max(1.0 - rise / BANK, 0.0) * shore.y;
    flow = flow_frame;
    stream = stream_params;
    coverage = 1.0;
    gl_Position = to_clip * vec4(position, 1.0);
    vec4 before = to_clip * vec4(position * (1.0 - nearer), 1.0);
    if (before.w > 0.0) gl_Position.z = before.z / before.w * gl_Position.w;

    vec3 right = vec3(flow_frame.w, -flow_frame.z, 0.0);
    vec4 centre = to_clip * vec4(position - flow_frame.x * right, 1.0);
    vec4 edge = to_clip * vec4(position + (stream_params.w - flow_frame.x) * right, 1.0);
    if (stream_params.w > 0.0 && min(min(centre.w, edge.w), gl_Position.w) > stream_params.w) {
        vec4 step_on = to_clip * vec4(flow_frame.zw, 0.0, 0.0);
        vec2 along = (step_on.xy * centre.w - centre.xy * step_on.w) * reach.zw;
        vec3 drawn = widened(in_picture(gl_Position), in_picture(centre), in_picture(edge), along);
        gl_Position.xy = drawn.xy / (0.5 * reach.zw) * gl_Position.w;
        coverage = drawn.z;
    }
}
