// Light on a material of the ground or of what is built on it, and noise that varies its colour. Needs frame, surface,
// matter, shade and clouds.
// Noise of about 1000, 100 and 10 m.
struct Noise {
    vec4 wide, middle, small;
};

const mat2 TURN = mat2(0.8, 0.6, -0.6, 0.8);
const vec4 REPEATS = vec4(5.0, 0.6, 30.0, 3.5); // m, footprints between which noise of 100 and 10 m fades
Noise noise_at(vec3 position, float footprint)
{
#if MATERIALS == 1
    vec4 middle = textureLod(noise_field, (position.xy + eye.xy) / 512.0 + 0.37, floor(log2(footprint) + 0.5));
    return Noise(middle.zxwy, middle, middle.yzxw);
#else
    // Turned by an angle of whole periods, 90 in that of the eye, the second one hides the repetition of the first.
    vec2 at = position.xy + eye.xy;
    vec4 middle = texture(noise_field, at / 512.0 + 0.37) + texture(noise_field, TURN * at * (90.0 / 65536.0) + 0.11);
    vec2 near = 1.0 - smoothstep(REPEATS.xy, REPEATS.zw, vec2(footprint)); // a pattern of many tiles is a weave
    return Noise(texture(noise_field, at / 4096.0), 0.7071 * near.x * middle, near.y * texture(noise_field, at / 64.0 + 0.71));
#endif
}

const float CROWN_FACING = 0.11; // share of the way to the eye that the visible leaves' normals lean
const float CROWN_SUN = 0.8;     // sunlight on them over that on an even surface: they shade each other
const float CROWN_WRAP = 0.5;    // wrap lighting, cosine: flanks that face a low sun, and light through leaves
const vec3 CROWN_GLOW = vec3(0.14, 0.15, 0.04); // share of sunlight that leaves let through towards it ...
const float CROWN_GLOW_POWER = 5.0; // ... and its exponent
const float CROWN_SKY = 0.5;    // sky visibility among crowns
const float CROWN_RELIEF = 0.8; // slopes of crowns over their texture's

// Radiance of a forest's crowns from afar: of the visible leaves, which face the eye and scatter light evenly, without
// an even surface's reflection at grazing angles. Uphill trees shade a slope. Calibrated with drawn trees
// (tests/render/test_canopy.py).
vec3 lit_canopy(MaterialSample crowns, vec3 position, vec3 n, vec3 to_eye, vec2 light)
{
    vec3 normal = normalize(n + CROWN_FACING * to_eye + CROWN_RELIEF * crowns.bump);
    float wrap = CROWN_WRAP * clamp(dot(n, to_sun.xyz) / to_sun.z, 0.0, 1.0);
    float facing = CROWN_SUN / (1.0 + CROWN_WRAP) * max(dot(normal, to_sun.xyz) + wrap, 0.0);
    vec3 sun = facing + CROWN_GLOW * pow(max(-dot(to_eye, to_sun.xyz), 0.0), CROWN_GLOW_POWER);
    sun *= light.x * cloud_shadow(position);
    return crowns.albedo / PI * (sun_light.rgb * sun + sky_irradiance(normal) * (light.y * CROWN_SKY));
}

// Radiance of a material at a position (m from the eye).
//   light  visibility of the sun and of the sky
vec3 lit_material(MaterialSample material, vec3 position, vec3 n, vec3 to_eye, vec2 light)
{
    vec3 normal = normalize(n + material.bump);
    float sun = light.x * tree_shade(position, n) * cloud_shadow(position);
    vec3 lit = reflectance(material.albedo, vec3(0.03), material.roughness, normal, to_eye, to_sun.xyz)
        * sun_light.rgb * sun;
    return lit + material.albedo / PI * sky_irradiance(normal) * (light.y * material.open);
}
