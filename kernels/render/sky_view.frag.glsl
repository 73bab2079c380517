#version 430 core
// Sky radiance by direction, seen from the ground: u is the angle from the sun's azimuth over π, v is
// √(elevation / 90°). Single scattering by molecules and aerosols, plus an isotropic share for the light that is
// scattered more than once. Coefficients at sea level from Bruneton & Neyret 2008 and Hillaire 2020, in 1/m.
#define PI 3.14159265358979
const float GROUND = 6360e3;
const float TOP = 6460e3;
const vec3 RAYLEIGH = vec3(5.802e-6, 13.558e-6, 33.1e-6);
const float RAYLEIGH_HEIGHT = 8000.0;
const float MIE = 3.996e-6;
const float MIE_ABSORPTION = 4.4e-7;
const float MIE_HEIGHT = 1200.0;
const vec3 OZONE = vec3(0.65e-6, 1.881e-6, 0.085e-6);
const float FORWARD = 0.76; // asymmetry of the aerosols' phase function

uniform vec3 sun_irradiance; // above the atmosphere
uniform float sun_height;    // sine of the sun's elevation
uniform float altitude;      // m
uniform float dust;          // aerosols, 1 = clear day
const float SIZE = 128.0;    // texels a side, sky.py

in vec2 uv;
out vec4 radiance;

struct Air {
    vec3 rayleigh;
    float mie;
    vec3 extinction;
};

Air air_at(float height)
{
    Air air;
    air.rayleigh = RAYLEIGH * exp(-height / RAYLEIGH_HEIGHT);
    float aerosol = dust * exp(-height / MIE_HEIGHT);
    air.mie = MIE * aerosol;
    air.extinction = air.rayleigh + (MIE + MIE_ABSORPTION) * aerosol
        + OZONE * max(0.0, 1.0 - abs(height - 25e3) / 15e3);
    return air;
}

float to_sphere(vec3 from, vec3 direction, float radius)
{
    float b = dot(from, direction);
    float d = b * b - dot(from, from) + radius * radius;
    return -b + sqrt(max(d, 0.0));
}

vec3 sunlight_at(vec3 from, vec3 to_sun)
{
    const int STEPS = 10;
    float length_ = to_sphere(from, to_sun, TOP);
    vec3 depth = vec3(0.0);
    float before = 0.0;
    for (int i = 0; i < STEPS; ++i) {
        float f = float(i + 1) / float(STEPS);
        float after = f * f * length_;
        depth += air_at(length(from + to_sun * 0.5 * (before + after)) - GROUND).extinction * (after - before);
        before = after;
    }
    return exp(-depth);
}

void main()
{
    vec2 size = vec2(SIZE);
    vec2 at = clamp((uv * size - 0.5) / (size - 1.0), 0.0, 1.0);
    float elevation = at.y * at.y * 0.5 * PI;
    float azimuth = at.x * PI;
    vec3 direction = vec3(cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), sin(elevation));
    vec3 to_sun = vec3(sqrt(1.0 - sun_height * sun_height), 0.0, sun_height);
    vec3 from = vec3(0.0, 0.0, GROUND + max(altitude, 1.0));

    float c = dot(direction, to_sun);
    float phase_rayleigh = 3.0 / (16.0 * PI) * (1.0 + c * c);
    float g2 = FORWARD * FORWARD;
    float phase_mie = 3.0 / (8.0 * PI) * (1.0 - g2) * (1.0 + c * c)
        / ((2.0 + g2) * pow(1.0 + g2 - 2.0 * FORWARD * c, 1.5));

    const int STEPS = 32;
    float length_ = to_sphere(from, direction, TOP);
    vec3 through = vec3(1.0);
    vec3 sum = vec3(0.0);
    float before = 0.0;
    for (int i = 0; i < STEPS; ++i) {
        float f = float(i + 1) / float(STEPS);
        float after = f * f * length_;
        float step_ = after - before;
        vec3 place = from + direction * 0.5 * (before + after);
        Air air = air_at(length(place) - GROUND);
        vec3 lit = sunlight_at(place, to_sun);
        vec3 once = (air.rayleigh * phase_rayleigh + air.mie * phase_mie) * lit;
        vec3 again = (air.rayleigh + air.mie) / (4.0 * PI) * (0.10 + 0.22 * lit);
        vec3 clear = exp(-air.extinction * step_);
        sum += through * (once + again) * (1.0 - clear) / max(air.extinction, vec3(1e-12));
        through *= clear;
        before = after;
    }
    radiance = vec4(sum * sun_irradiance, 1.0);
}
