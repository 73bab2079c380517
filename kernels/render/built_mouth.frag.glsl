#version 430 core
// The opening of a tunnel where it is seen: removes the ground behind it, before the inside is drawn.
uniform sampler2D scene_depth; // a copy

out vec4 radiance;

void main()
{
    if (gl_FragCoord.z > texelFetch(scene_depth, ivec2(gl_FragCoord.xy), 0).r) discard;
    radiance = vec4(0.0, 0.0, 0.0, 1.0);
    gl_FragDepth = 1.0;
}
