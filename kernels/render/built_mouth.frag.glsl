#version 430 core
// The opening of a tunnel: removes the ground behind it, before the inside is drawn.
out vec4 radiance;

void main()
{
    radiance = vec4(0.0, 0.0, 0.0, 1.0);
    gl_FragDepth = 1.0;
}
