#version 430 core
// A plant in a shadow map.
uniform mat4 to_map; // from the anchor of all plants to the map's clip space

in vec3 local_position;
in vec4 foot_height;
in vec4 appearance;

void main()
{
    mat2 turn = mat2(appearance.x, appearance.y, -appearance.y, appearance.x);
    gl_Position = to_map * vec4(foot_height.xyz + foot_height.w * vec3(turn * local_position.xy, local_position.z), 1.0);
}
