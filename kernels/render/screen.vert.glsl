#version 430 core
// One triangle that covers the screen.
out vec2 uv; // 0..1 across the framebuffer

void main()
{
    uv = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
    gl_Position = vec4(uv * 2.0 - 1.0, 1.0, 1.0);
}
