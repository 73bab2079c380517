#version 430 core
// Whether the drawn ground leaves the anchor of a label in view.
#include "render/frame.glsl"

const float NEARER = 0.99; // share of the distance to the eye: levels of detail differ from true heights
const float ROUNDING = 2e-7; // of depths

in vec3 place; // m from the first anchor

uniform vec3 origin;  // the first anchor, m from the eye
uniform float lift;   // share of the picture's height: what is this far above the ground is in view
uniform sampler2D drawn_depth;

out float seen;

void main()
{
    vec4 at = to_clip * vec4((place + origin) * NEARER, 1.0);
    vec3 window = at.xyz / max(at.w, 1e-6) * 0.5 + 0.5;
    float drawn = textureLod(drawn_depth, clamp(window.xy + vec2(0.0, lift), 0.0, 1.0), 0.0).r;
    seen = float(at.w > 0.0 && drawn >= window.z - ROUNDING);
}
