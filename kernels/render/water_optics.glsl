// Reflection and absorption of water. Pure. `cosine`: of the angle between a direction and the
// vertical. `spread`: standard deviation of the surface's slope along one axis. Oracle: tests/render/test_water.py.
const float WATER_INDEX = 1.333;
const float WATER_HEAD_ON = 0.0203; // ((n - 1) / (n + 1))^2: share that is mirrored head on

// Cosine of a ray in the water, below one in the air (Snell).
float refracted_cosine(float cosine)
{
    return sqrt(1.0 - (1.0 - cosine * cosine) / (WATER_INDEX * WATER_INDEX));
}

// Reflectance of a rough surface: Schlick's term averaged over the visible slopes
// (Bruneton, Neyret & Holzschuch 2010, section 4.3). Schlick's own where the surface is smooth.
float mirrored_share(float cosine, float spread)
{
    float power = 5.0 * exp(-2.69 * spread);
    return WATER_HEAD_ON
        + (1.0 - WATER_HEAD_ON) * pow(1.0 - clamp(cosine, 0.0, 1.0), power) / (1.0 + 22.7 * pow(spread, 1.5));
}

// Smith's Lambda for slopes with a normal distribution, as a rational function (Walter et al. 2007, section 5.2).
float hidden_share(float cosine, float spread)
{
    float sine = sqrt(max(1.0 - cosine * cosine, 1e-8));
    float a = cosine / (1.41421356 * spread * sine);
    return a < 1.6 ? (1.0 - 1.259 * a + 0.396 * a * a) / max(3.535 * a + 2.181 * a * a, 1e-6) : 0.0;
}

// Mean slope towards the eye of the visible facets. A facet of slope s counts by its projected area,
// max(cosine + s sine, 0); over normally distributed slopes the mean is spread / (a + phi(a) / Phi(a)) with
// a = cosine / (spread sine). Phi: normal distribution function, as a logistic one (Bowling et al. 2009).
float seen_slope(float cosine, float spread)
{
    float sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    float a = min(cosine / max(spread * sine, 1e-6), 1e4);
    float density = 0.39894228 * exp(-0.5 * a * a);
    float below = 1.0 / (1.0 + exp(-(1.5976 * a + 0.07056 * a * a * a)));
    return spread / (a + density / below);
}

// Standard deviation of those slopes, of their mean: their second moment is spread² (2 - a mean / spread).
float seen_spread(float cosine, float spread, float mean)
{
    return sqrt(max(2.0 * spread * spread - mean * (mean + cosine * inversesqrt(max(1.0 - cosine * cosine, 1e-8))), 0.0));
}

// Radiance of the sun's glitter for an irradiance of 1 on a surface that faces it (Ross et al. 2005; Bruneton et al.
// 2010, equation 8). Slopes are normally distributed about `slope`; directions point away from the surface.
float glitter(vec3 to_eye, vec3 to_light, vec2 slope, float spread)
{
    vec3 half_way = normalize(to_eye + to_light);
    float up = max(half_way.z, 0.05);
    vec2 off = -half_way.xy / up - slope;
    float facets = exp(-0.5 * dot(off, off) / (spread * spread)) / (6.2831853 * spread * spread);
    float eye_up = clamp(to_eye.z, 0.02, 1.0), light_up = clamp(to_light.z, 0.02, 1.0);
    float seen = 1.0 + hidden_share(eye_up, spread) + hidden_share(light_up, spread);
    float share = mirrored_share(dot(half_way, to_eye), 0.0);
    return to_light.z > 0.0 ? share * facets / (4.0 * up * up * up * up * eye_up * seen) : 0.0;
}

// Transmittance of water, down to the bed and up to the eye (Beer–Lambert).
//   extinction   1/m
//   depth        of the bed, m
//   up, down     cosines in the water of the ray to the eye and of the light's
vec3 let_through(vec3 extinction, float depth, float up, float down)
{
    return exp(-extinction * (depth * (1.0 / up + 1.0 / down)));
}

// Diffuse reflectance of infinitely deep water (Gordon et al. 1975: R = 0.33 backscatter / absorption).
vec3 deep_colour(vec3 absorption, vec3 backscatter)
{
    return 0.33 * backscatter / (absorption + backscatter);
}
