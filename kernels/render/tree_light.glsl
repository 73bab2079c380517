// Light that leaves and bark reflect. Leaves transmit light in a yellower colour; a crown scatters like a cloud, so light
// wraps around it (a soft terminator) and glows through its rim. Pure but for the frame's light.

const float WRAP = 0.30;                         // wrap lighting of a crown, cosine
const vec3 THROUGH = vec3(1.15, 1.25, 0.35);     // transmitted colour over albedo
const float THROUGH_SHARE = 0.62;                // transmittance over reflectance
const float GLOW = 5.0;                          // exponent of forward scattering
const float GLOSS = 0.10;                        // of the leaves' wax
const float GLOSS_POWER = 14.0;

//   colour  albedo
//   n       unit normal
//   leafy   1 leaf, 0 wood
//   seen    unit vector from the eye
//   sun     sun visibility; sky: sky visibility among other plants
//   open    openness of the crown
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
    // Interreflection between leaves: greener, and brighter than a single bounce.
    vec3 among = colour / (1.0 - 0.75 * colour * (1.0 - open));
    return lit + among / PI * sky_irradiance(normalize(n + vec3(0.0, 0.0, 0.3))) * sky * open;
}
