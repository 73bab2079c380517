#version 430 core
// A plant as the sun sees it.
uniform mat4 to_map; // from the anchor of all plants to the map's clip space

in vec3 place;
in vec4 stand;
in vec4 manner;

void main()
{
    mat2 turn = mat2(manner.x, manner.y, -manner.y, manner.x);
    gl_Position = to_map * vec4(stand.xyz + stand.w * vec3(turn * place.xy, place.z), 1.0);
}
