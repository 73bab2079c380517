#version 430 core
// Second step of draping: what the first step drew at the foot of a pixel's ground on the approximation.
#include "render/frame.glsl"
#include "render/gbuffer.glsl"
#include "render/draped_smooth.glsl"

uniform sampler2D ground_depth;
uniform sampler2D smooth_depth; // of the approximation
uniform sampler2D drawn;        // in the first step

layout(location = 0) out vec4 colour;

const float BEHIND = 0.02; // share of the distance by which nearer parts of the approximation hide a foot

void main()
{
    float depth;
    ivec2 pixel = ivec2(gl_FragCoord.xy), at = nearest_sample(ground_depth, pixel, depth);
    if (depth >= 1.0) discard;
    vec2 place = position_of(ground_depth, at, depth).xy;
    vec4 foot = to_clip * vec4(place, smooth_height(place), 1.0);
    vec2 to_middle = (vec2(pixel) + 0.5) * float(SAMPLES) - (vec2(at) + 0.5); // of the pixel
    vec2 uv = 0.5 + 0.5 * foot.xy / foot.w + to_middle / vec2(textureSize(ground_depth, 0));
    bool inside = foot.w > 0.0 && all(equal(uv, clamp(uv, 0.0, 1.0)))
        && foot.w < distance_of(textureLod(smooth_depth, uv, 0.0).r) * (1.0 + BEHIND);
    colour = inside ? textureLod(drawn, uv, 0.0) : vec4(0.0);
}
