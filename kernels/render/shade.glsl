// Shadows of trees from two shadow maps: near (sharp, around the eye) and far. Each is cross-faded from its
// predecessor. SHADE_MAPS: 2: both, 1: far only, 0: none.
#ifndef SHADE_MAPS
#define SHADE_MAPS 2
#endif
uniform sampler2DShadow shade_near;
uniform sampler2DShadow shade_far;
uniform sampler2DShadow shade_near_before;
uniform sampler2DShadow shade_far_before;

// Light of a map at a position, faded to `beyond` outside the map.
float in_map(sampler2DShadow map, mat4 to_map, vec3 place, float beyond)
{
    vec3 at = (to_map * vec4(place, 1.0)).xyz * 0.5 + 0.5;
    vec2 margin = abs(at.xy - 0.5);
    return mix(texture(map, at), beyond, smoothstep(0.42, 0.48, max(margin.x, margin.y)));
}

// Share of sunlight that trees let through.
float tree_shade(vec3 place, vec3 normal)
{
    float lit = 1.0;
#if SHADE_MAPS > 0
    vec3 far_place = place + normal * 0.6;
    lit = mix(in_map(shade_far_before, to_shade[3], far_place, 1.0), in_map(shade_far, to_shade[1], far_place, 1.0),
        shade_share.y);
#endif
#if SHADE_MAPS > 1
    vec3 near_place = place + normal * 0.15;
    lit = mix(in_map(shade_near_before, to_shade[2], near_place, lit), in_map(shade_near, to_shade[0], near_place, lit),
        shade_share.x);
#endif
    return lit;
}
