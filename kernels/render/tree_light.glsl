// What a leaf or a piece of bark sends to the eye. Leaves are thin: what light they do not send back comes out at their
// other side, yellower; a crown is a cloud of them, so light wraps round it (a soft terminator) and glows through its rim.
// Pure but for the frame's light.

const float WRAP = 0.30;                         // how far light reaches round a crown, cosine
const vec3 THROUGH = vec3(1.15, 1.25, 0.35);     // colour of light that comes through a leaf, over its albedo
const float THROUGH_SHARE = 0.62;                // of it, against what is sent back
const float GLOW = 5.0;                          // how narrow the glow about the sun is
const float GLOSS = 0.10;                        // of leaves' wax
const float GLOSS_POWER = 14.0;

//   colour  albedo
//   n       unit normal
//   leafy   1 leaf, 0 wood
//   seen    unit vector from the eye
//   sun     share of the sun that reaches it; sky: of the sky's light, as far as other plants leave it
//   open    openness within the plant
vec3 leaf_light(vec3 colour, vec3 n, float leafy, vec3 seen, float sun, float sky, float open)
{
    float facing = dot(n, to_sun.xyz);
    float wrap = WRAP * leafy;
    float front = max(facing + wrap, 0.0) / ((1.0 + wrap) * (1.0 + wrap));
    float back = leafy * THROUGH_SHARE * (0.35 * max(-facing, 0.0) + 0.75 * pow(max(dot(seen, to_sun.xyz), 0.0), GLOW));
    float inner = mix(1.0, 0.5 + 0.5 * open, leafy);
    vec3 lit = (colour * front + colour * THROUGH * back) / PI;
    float gloss = leafy * GLOSS * pow(max(dot(n, normalize(to_sun.xyz - seen)), 0.0), GLOSS_POWER);
    lit = (lit + gloss * 0.04) * sun_light.rgb * (sun * inner);
    // What leaves send to each other makes the light among them greener, and less dark than one bounce alone.
    vec3 among = colour / (1.0 - 0.75 * colour * (1.0 - open));
    return lit + among / PI * sky_irradiance(normalize(n + vec3(0.0, 0.0, 0.3))) * sky * open;
}
