#version 430 core
// A label as two triangles (six vertices) in pixels of the picture.
in vec2 low;    // lower left corner, px
in vec2 extent; // px
in vec2 cell;   // upper left corner in the atlas, px
in vec4 colour; // of the letters, and opacity

uniform vec2 size; // of the picture, px

out vec2 texel;
flat out vec4 ink;

void main()
{
    int number = int[6](0, 1, 2, 2, 1, 3)[gl_VertexID];
    vec2 corner = vec2(number & 1, number >> 1);
    texel = cell + vec2(corner.x, 1.0 - corner.y) * extent;
    ink = colour;
    gl_Position = vec4((low + corner * extent) / size * 2.0 - 1.0, 0.0, 1.0);
}
