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
