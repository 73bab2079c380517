// Foam coverage. Pure; oracle: tests/render/test_water.py.

// Share of a pixel covered by foam, from a value of noise of mean 0 and standard deviation 0.5.
//   amount   mean coverage, about 0 ... 1
//   lost     standard deviation of the noise that the pixel does not resolve
// The noise is thresholded; unresolved noise softens the threshold, so that distant foam has the same coverage.
float foam_share(float noise, float amount, float lost)
{
    const float SOFT = 0.2;
    float threshold = mix(1.15, -0.75, sqrt(clamp(amount, 0.0, 1.0)));
    float soft = SOFT + 1.7 * lost;
    return smoothstep(threshold - soft, threshold + soft, noise) * step(1e-4, amount);
}

// Opacity of foam: a web of bubbles, a blanket where there is much of it.
//   share   of foam_share; amount: given to it; web: a noise whose zeros are the threads
float foam_cover(float share, float amount, float web)
{
    float threads = 1.0 - smoothstep(0.02, 0.28, abs(web));
    return 0.85 * share * mix(0.75 * threads, 1.0, smoothstep(0.06, 0.4, amount) * share);
}

// Foam amount of a shore at a depth (m): a thin line that moves with the swell.
//   beat     -1 ... 1, of the swell
//   reach    depth at which it ends, m
float shore_foam(float depth, float beat, float reach)
{
    float line = reach * (0.45 + 0.25 * beat);
    float width = 0.4 * reach;
    float off = (depth - line) / width;
    return exp(-off * off) + 0.35 * (1.0 - smoothstep(0.0, reach, depth));
}

// Foam amount of a stream: where it is steep, and a little along its banks.
//   fall     of the water, m a metre
//   across   1 at the bank
float stream_foam(float fall, float across)
{
    float steep = smoothstep(0.015, 0.25, fall);
    float bank = smoothstep(0.72, 0.98, abs(across));
    return clamp(0.0015 + 0.5 * steep + bank * (0.008 + 0.15 * steep), 0.0, 0.8);
}

// Height (m) of the waves that break at a coast: a swell, and the significant height of a sea raised by a wind (m/s)
// (Pierson & Moskowitz 1964).
float surf_height(float wind) { return 0.35 + 0.0214 * wind * wind; }

// Number of waves between a depth (m) and the shore, of a period (s): the travel time at the speed sqrt(g depth) of shallow
// water, on a bed of slope BEACH.
float waves_to_shore(float depth, float period)
{
    const float GRAVITY = 9.81;
    const float BEACH = 0.05;
    return 2.0 * sqrt(max(depth, 0.0) / GRAVITY) / (BEACH * period);
}

// Foam amount of surf: bores that run ashore where waves break, at depths below 1.28 heights (McCowan 1894), and the wash
// of the last one.
//   depth     m
//   height    of the waves, m
//   passed    number of waves, growing away from the shore and with time: whole numbers are fronts
//   seen      share of a bore's length that the pixel resolves
float surf_foam(float depth, float height, float passed, float seen)
{
    const float TRAIL = 5.0; // decay of foam behind a front
    float zone = 1.0 - smoothstep(0.35, 1.0, depth / (1.28 * height));
    float bore = mix((1.0 - exp(-TRAIL)) / TRAIL, exp(-TRAIL * fract(passed)), seen);
    float wash = 1.0 - smoothstep(0.0, 0.12 * height, depth);
    return clamp(zone * bore * (0.5 + 0.5 * zone) + 0.5 * wash, 0.0, 0.9);
}

// Share of the open sea under whitecaps at a wind (m/s) (Monahan & O'Muircheartaigh 1980).
float whitecaps(float wind) { return min(3.84e-6 * pow(max(wind, 0.0), 3.41), 0.3); }
