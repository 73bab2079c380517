#version 430 core
// A terrain vertex projected from above onto the surface map.
#include "render/ground.glsl"

uniform vec3 map_place; // xy: the map's south-west corner relative to the eye, m; z: 2 / its width, 1/m

out float height_over_eye; // m

void main()
{
    ivec2 place = place_in_tile();
    float share = parent_share(place);
    vec3 at = ground_position(place, share);
    clip_to_bounds(at);
    ground_normal = ground_normal_at(share);
    emit_weights(share);
    height_over_eye = at.z;
    gl_Position = vec4((at.xy - map_place.xy) * map_place.z - 1.0, 0.0, 1.0);
}
