// Shadows that trees throw, from two shadow maps seen from the sun: a small sharp one about the eye, a wide one.
// SHADE_MAPS: 2 both, 1 the wide one, 0 none.
#ifndef SHADE_MAPS
#define SHADE_MAPS 2
#endif
uniform sampler2DShadow shade_near;
uniform sampler2DShadow shade_far;

// 1 where no tree stands between a point and the sun.
float tree_shade(vec3 place, vec3 normal)
{
#if SHADE_MAPS == 0
    return 1.0;
#else
    vec3 far_at = (to_shade[1] * vec4(place + normal * 0.6, 1.0)).xyz * 0.5 + 0.5;
    vec2 far_margin = abs(far_at.xy - 0.5);
    float beyond_far = smoothstep(0.42, 0.48, max(far_margin.x, far_margin.y));
    float wide = mix(texture(shade_far, far_at), 1.0, beyond_far);
#if SHADE_MAPS == 1
    return wide;
#else
    vec3 near_at = (to_shade[0] * vec4(place + normal * 0.15, 1.0)).xyz * 0.5 + 0.5;
    vec2 near_margin = abs(near_at.xy - 0.5);
    float beyond_near = smoothstep(0.42, 0.48, max(near_margin.x, near_margin.y));
    return mix(texture(shade_near, near_at), wide, beyond_near);
#endif
#endif
}
