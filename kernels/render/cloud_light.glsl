// Lighting of clouds. Pure but for the frame's light.
uniform vec3 cloud_sun; // irradiance of the sun at the clouds' height

// Henyey and Greenstein's phase function, 1/sr.
float scattered(float cosine, float g)
{
    float far = 1.0 + g * g - 2.0 * g * cosine;
    return (1.0 - g * g) / (4.0 * PI * far * sqrt(far));
}

const vec3 ATTENUATED = vec3(1.0, 0.38, 0.38 * 0.38); // optical depth of the orders of scattering

// In-scattered sunlight of a point in a cloud over its extinction: higher orders are attenuated less and less directional
// (Wrenninge, Kulla & Lundqvist 2013). `cosine` to the sun; this is their phase functions, constant along a ray.
vec3 cloud_phases(float cosine)
{
    vec3 phases;
    float share = 1.0, sharp = 1.0;
    for (int i = 0; i < 3; ++i) {
        phases[i] = share * mix(scattered(cosine, -0.15 * sharp), scattered(cosine, 0.75 * sharp), 0.6);
        share *= 0.62;
        sharp *= 0.45;
    }
    return phases;
}

// `depth`: optical, towards the sun.
vec3 sunlit(float depth, vec3 phases) { return cloud_sun * dot(phases, exp(-ATTENUATED * depth)); }

const float SUN_GAIN = 1.75;   // over three orders of scattering
const float CLOUD_GREY = 0.45; // share of ambient light from other clouds, colourless

// Light of sky and ground in a cloud; `rise`: 0 at its base, 1 at its top.
vec3 cloud_ambient(float rise)
{
    vec3 above = sky_irradiance(vec3(0.0, 0.0, 1.0)), below = sky_irradiance(vec3(0.0, 0.0, -1.0));
    vec3 light = (above * mix(0.22, 0.85, rise) + below * mix(0.7, 0.2, rise)) / PI;
    return mix(light, vec3(dot(light, vec3(0.2126, 0.7152, 0.0722))), CLOUD_GREY);
}
