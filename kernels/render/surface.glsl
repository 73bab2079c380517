// BRDF of rough surfaces. All functions are pure; vectors are unit vectors.

// Schlick's Fresnel term: reflectance `f0` at normal incidence, 1 at grazing incidence.
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

// Diffuse reflection of a rough surface, over π (Hammon 2017, PBR Diffuse Lighting for GGX+Smith Microsurfaces), with
// retroreflection. Scaled to conserve energy.
vec3 diffuse_reflection(vec3 albedo, vec3 f0, float g, float nl, float nv, float nh, float lv)
{
    float facing = 0.5 + 0.5 * lv;
    float rough = facing * (0.9 - 0.4 * facing) * (0.5 + nh) / nh;
    float l = 1.0 - nl, v = 1.0 - nv;
    float l2 = l * l, v2 = v * v;
    vec3 even = 1.05 * (1.0 - f0) * (1.0 - l2 * l2 * l) * (1.0 - v2 * v2 * v);
    float most = 1.03 + 0.165 * g * g * g; // unscaled reflection of a white surface under uniform light
    return albedo * (mix(even, vec3(rough), g) / 3.14159265358979 + 0.1159 * g * albedo) / most;
}

// BRDF times cosine of incidence.
vec3 reflectance(vec3 albedo, vec3 f0, float roughness, vec3 normal, vec3 to_eye, vec3 to_light)
{
    float g = max(roughness * roughness, 0.02);
    vec3 between = to_eye + to_light;
    between *= inversesqrt(max(dot(between, between), 1e-8));
    float nl = clamp(dot(normal, to_light), 0.0, 1.0);
    float nv = clamp(dot(normal, to_eye), 1e-3, 1.0);
    float nh = clamp(dot(normal, between), 0.1, 1.0);
    vec3 mirrored = schlick(f0, dot(to_light, between)) * (trowbridge_reitz(nh, g) * smith(nl, nv, g));
    return nl * (diffuse_reflection(albedo, f0, g, nl, nv, nh, dot(to_light, to_eye)) + mirrored);
}
