// Tone mapping. All functions are pure.

// AgX (T. Sobotka 2022) with B. Wrensch's polynomial for its curve: linear sRGB in, display-encoded sRGB out. Colours
// are desaturated before the curve and saturated after it, so that bright ones fade to white in their own hue.
const float DARKEST = -12.47393;  // log2 of radiance mapped to black
const float BRIGHTEST = 4.026069; // and to white
const float ANCHOR = 0.845;       // exposure that preserves middle grey
const float CONTRAST = 0.6;       // weight of an S-curve, 0 .. 1
const float SATURATION = 1.12;

float tone_curve(float x)
{
    float x2 = x * x, x4 = x2 * x2;
    return 15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232;
}

const mat3 FILM_INSET = mat3(0.842479062253094, 0.0423282422610123, 0.0423756549057051, 0.0784335999999992,
    0.878468636469772, 0.0784336, 0.0792237451477643, 0.0791661274605434, 0.879142973793104);
const mat3 FILM_OUTSET = mat3(1.19687900512017, -0.0528968517574562, -0.0529716355144438, -0.0980208811401368,
    1.15190312990417, -0.0980434501171241, -0.0990297440797205, -0.0989611768448433, 1.15107367264116);
const vec3 LUMA = vec3(0.2126, 0.7152, 0.0722);

vec3 tone_of(vec3 x)
{
    vec3 c = clamp(vec3(tone_curve(x.r), tone_curve(x.g), tone_curve(x.b)), 0.0, 1.0);
    return mix(c, c * c * (3.0 - 2.0 * c), CONTRAST);
}

vec3 film(vec3 light)
{
    vec3 c = log2(max(FILM_INSET * (ANCHOR * light), vec3(1e-10)));
    c = tone_of(clamp((c - DARKEST) / (BRIGHTEST - DARKEST), 0.0, 1.0));
    float grey = dot(c, LUMA);
    return clamp(FILM_OUTSET * (grey + SATURATION * (c - grey)), 0.0, 1.0);
}

// The light that `film` shows as a colour.
vec3 light_of(vec3 colour)
{
    vec3 c = inverse(FILM_OUTSET) * colour, low = vec3(0.0), high = vec3(1.0);
    float grey = dot(c, LUMA);
    c = clamp(grey + (c - grey) / SATURATION, 0.0, 1.0);
    for (int k = 0; k < 14; ++k) {
        vec3 middle = 0.5 * (low + high);
        bvec3 above = greaterThan(tone_of(middle), c);
        low = mix(middle, low, above);
        high = mix(high, middle, above);
    }
    return inverse(FILM_INSET) * exp2(DARKEST + 0.5 * (low + high) * (BRIGHTEST - DARKEST)) / ANCHOR;
}
