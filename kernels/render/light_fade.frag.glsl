#version 430 core
// From the light of one map to that of its successor, texel by texel: both lie on the same grid.
uniform sampler2D old;
uniform sampler2D new;
uniform ivec2 shift; // of the new map's corner from the old one's, texels
uniform float share; // of the new one, 0..1

out vec4 light;

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 after = texelFetch(new, at, 0);
    ivec2 there = at + shift;
    bool known = all(greaterThanEqual(there, ivec2(0))) && all(lessThan(there, textureSize(old, 0)));
    light = known ? mix(texelFetch(old, there, 0), after, share) : after;
}
