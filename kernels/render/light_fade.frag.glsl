#version 430 core
// Blends a light map into its successor; both are aligned to the same texel grid.
uniform sampler2D old;
uniform sampler2D new;
uniform ivec2 shift; // offset of the new map's corner, texels
uniform float share; // weight of the new map, 0..1

out vec4 light;

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 after = texelFetch(new, at, 0);
    ivec2 there = at + shift;
    bool known = all(greaterThanEqual(there, ivec2(0))) && all(lessThan(there, textureSize(old, 0)));
    light = known ? mix(texelFetch(old, there, 0), after, share) : after;
}
