// Light on a material of the ground or of what is built on it, and noise that varies its colour. Needs frame, surface,
// matter, shade and clouds.
// Noise of about 1000, 100 and 10 m.
struct Noise {
    vec4 wide, middle, small;
};

Noise noise_at(vec3 position, float footprint)
{
#if MATERIALS == 1
    vec4 middle = textureLod(noise_field, (position.xy + eye.xy) / 512.0 + 0.37, floor(log2(footprint) + 0.5));
    return Noise(middle.zxwy, middle, middle.yzxw);
#else
    return Noise(texture(noise_field, (position.xy + eye.xy) / 4096.0),
        texture(noise_field, (position.xy + eye.xy) / 512.0 + 0.37),
        texture(noise_field, (position.xy + eye.xy) / 64.0 + 0.71));
#endif
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
