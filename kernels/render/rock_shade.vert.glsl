#version 430 core
// Contact shadow of a stone: a square in the ground's plane, from under the stone away from the sun.
#include "render/frame.glsl"

in vec4 centre_radius; // of the stone, captured from rock_place.vert.glsl
in vec4 ground;
in vec4 kind;

out vec3 from_middle; // of the ground's point from the stone's centre, radii
out vec4 share;       // xyz: the ground's normal; w: share of direct sun in its irradiance

const float ROUND = 1.9;  // radii with occluded sky
const float LONGEST = 4.0; // of its shadow, radii
const float NEARER = 0.012; // relative depth offset, for uneven ground

void main()
{
    vec2 at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    vec3 n = ground.xyz;
    vec3 flat_sun = to_sun.xyz - n * dot(n, to_sun.xyz);
    float sine = max(dot(n, to_sun.xyz), 0.0);
    vec3 away = -flat_sun / max(length(flat_sun), 1e-4);
    vec3 across = cross(n, away);
    float longest = min(length(flat_sun) / max(sine, 0.05), LONGEST);
    float ahead = at.x > 0.0 ? ROUND + longest : ROUND;
    vec3 on_plane = away * (at.x * ahead) + across * (at.y * ROUND) - n * (ground.w / max(centre_radius.w, 1e-4));
    from_middle = on_plane;
    vec3 sun = sun_light.rgb * sine * kind.y, sky = sky_irradiance(n) * kind.z;
    share = vec4(n, dot(sun, vec3(1.0)) / max(dot(sun + sky, vec3(1.0)), 1e-6));
    vec3 position = centre_radius.xyz + on_plane * centre_radius.w;
    gl_Position = to_clip * vec4(position * (1.0 - NEARER), 1.0);
}
