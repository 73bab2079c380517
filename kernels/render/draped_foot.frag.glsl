#version 430 core
// Second step of draping: what the first step drew at the foot of a pixel's ground on the approximation.
#include "render/frame.glsl"
#include "render/draped_smooth.glsl"
#include "render/draped_depth.glsl"

uniform sampler2D ground_depth;
uniform sampler2D smooth_depth; // of the approximation
uniform sampler2D drawn;        // in the first step
uniform float marks_outside;    // 1: white where the foot is not in the buffer, instead

layout(location = 0) out vec4 colour;

const float BEHIND = 0.02; // share of the distance by which nearer parts of the approximation hide a foot

void main()
{
    ivec2 first = ivec2(gl_FragCoord.xy) * SAMPLES, at = first;
    float depth = 1.0;
    for (int k = 0; k < SAMPLES * SAMPLES; ++k) {
        ivec2 sample_ = first + ivec2(k % SAMPLES, k / SAMPLES);
        float d = texelFetch(ground_depth, sample_, 0).r;
        at = d < depth ? sample_ : at;
        depth = min(d, depth);
    }
    if (depth >= 1.0) discard;
    vec2 size = vec2(textureSize(ground_depth, 0)), screen = (vec2(at) + 0.5) / size;
    vec4 ground = from_clip * vec4(vec3(screen, depth) * 2.0 - 1.0, 1.0);
    vec2 place = ground.xy / ground.w;
    vec4 foot = to_clip * vec4(place, smooth_height(place), 1.0);
    vec2 to_middle = (vec2(first) + 0.5 * float(SAMPLES)) / size - screen; // of the pixel
    vec2 uv = 0.5 + 0.5 * foot.xy / foot.w + to_middle;
    bool inside = foot.w > 0.0 && all(equal(uv, clamp(uv, 0.0, 1.0)))
        && foot.w < distance_of(textureLod(smooth_depth, uv, 0.0).r) * (1.0 + BEHIND);
    colour = marks_outside > 0.0 ? vec4(inside ? 0.0 : 1.0) : inside ? textureLod(drawn, uv, 0.0) : vec4(0.0);
}
