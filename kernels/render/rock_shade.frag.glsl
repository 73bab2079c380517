#version 430 core
// Light that a spherical occluder leaves on the ground around it; multiplied into the picture.
#include "render/frame.glsl"

in vec3 from_middle; // radii
in vec4 share;
out vec4 left;

const float BALL = 0.72; // radius of the occluder, radii of the stone

void main()
{
    float away = length(from_middle);
    vec3 to_stone = -from_middle / max(away, 1e-3);
    // Sky occluded by a sphere (Quilez 2006), and the sun by the distance of its ray from the centre.
    float hidden = max(dot(share.xyz, to_stone) + 0.35, 0.0) * BALL * BALL / max(away * away, BALL * BALL);
    float along = dot(-from_middle, to_sun.xyz);
    float beside = length(-from_middle - along * to_sun.xyz);
    float soft = 0.10 + 0.07 * max(along, 0.0);
    float shade = along > 0.0 ? 1.0 - smoothstep(BALL - soft, BALL + soft, beside) : 0.0;
    float edge = 1.0 - smoothstep(1.2, 1.9, away - max(along, 0.0) * 0.9);
    left = vec4(vec3(1.0 - edge * (share.w * shade + (1.0 - share.w) * min(0.9 * hidden, 0.85))), 1.0);
}
