// A smooth approximation of the ground (m from the eye), for two-step draping. Include after frame.glsl.
uniform sampler2D near_heights; // m, mipmaps, in the squares near_map and far_map
uniform sampler2D far_heights;
uniform vec2 smooth_levels;     // mipmap levels of both

const float BLENDED_BORDER = 0.125; // of the near map, over which it is blended with the far one

float smooth_height(vec2 place)
{
    vec2 close = (place - near_map.xy) * near_map.z, wide = (place - far_map.xy) * far_map.z;
    vec2 room = min(close, 1.0 - close);
    float share = clamp(min(room.x, room.y) / BLENDED_BORDER, 0.0, 1.0);
    return mix(textureLod(far_heights, wide, smooth_levels.y).r, textureLod(near_heights, close, smooth_levels.x).r, share) - eye.z;
}
