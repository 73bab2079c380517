// Light on a rough surface. All functions are pure; lengths of vectors are 1 where nothing else is said.

// Schlick's Fresnel term: reflectance `f0` head on, 1 at grazing light.
vec3 schlick(vec3 f0, float cosine)
{
    float c = 1.0 - clamp(cosine, 0.0, 1.0);
    float c2 = c * c;
    return f0 + (1.0 - f0) * (c2 * c2 * c);
}

// Trowbridge and Reitz's distribution of facets, roughness g in (0, 1]; integrates to 1 over projected area.
float trowbridge_reitz(float cosine, float g)
{
    float d = cosine * cosine * (g * g - 1.0) + 1.0;
    return g * g / (3.14159265358979 * d * d);
}

// Smith's masking and shadowing over 4 (n·l)(n·v), in Hammon's approximation.
float smith(float to_light, float to_eye, float g)
{
    return 0.5 / max(mix(2.0 * to_light * to_eye, to_light + to_eye, g), 1e-4);
}

// Share of light from `to_light` that a surface sends to `to_eye`, times the cosine of incidence; what is reflected
// at the surface does not go into it, so no energy is made.
vec3 reflectance(vec3 albedo, vec3 f0, float roughness, vec3 normal, vec3 to_eye, vec3 to_light)
{
    float g = max(roughness * roughness, 0.02);
    vec3 between = normalize(to_eye + to_light);
    float nl = max(dot(normal, to_light), 0.0);
    float nv = max(dot(normal, to_eye), 1e-3);
    vec3 mirrored = schlick(f0, dot(to_light, between));
    float facets = trowbridge_reitz(max(dot(normal, between), 0.0), g) * smith(nl, nv, g);
    return nl * ((1.0 - mirrored) * albedo / 3.14159265358979 + mirrored * facets);
}
