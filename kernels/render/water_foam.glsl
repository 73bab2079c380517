// Where foam floats. Pure functions; oracle: tests/render/test_water.py.

// Share of a pixel that foam covers where a noise of mean 0 and standard deviation 0.5 has a value.
//   amount   share of the water that foam covers on the whole, about 0 ... 1
//   lost     standard deviation of the noise that the pixel is too coarse for
// Foam is where the noise is above a threshold; what is lost softens the threshold, so that far foam keeps its share.
float foam_share(float noise, float amount, float lost)
{
    const float SOFT = 0.2;
    float threshold = mix(1.15, -0.75, sqrt(clamp(amount, 0.0, 1.0)));
    float soft = SOFT + 1.7 * lost;
    return smoothstep(threshold - soft, threshold + soft, noise) * step(1e-4, amount);
}

// How much of what is behind it foam hides: a web of bubbles, a blanket where there is much of it.
//   share   of foam_share; amount: given to it; web: a noise whose zeros are the threads
float foam_cover(float share, float amount, float web)
{
    float threads = 1.0 - smoothstep(0.02, 0.28, abs(web));
    return 0.85 * share * mix(0.75 * threads, 1.0, smoothstep(0.06, 0.4, amount) * share);
}

// How much foam a shore makes at a depth (m): a thin line that swells up the shore and falls back.
//   beat     -1 ... 1, of the swell
//   reach    depth at which it ends, m
float shore_foam(float depth, float beat, float reach)
{
    float line = reach * (0.45 + 0.25 * beat);
    float width = 0.4 * reach;
    float off = (depth - line) / width;
    return exp(-off * off) + 0.35 * (1.0 - smoothstep(0.0, reach, depth));
}

// How much foam a stream makes: where its bed is steep, and a little along its banks.
//   fall     of the water, m a metre
//   across   1 at the bank
float stream_foam(float fall, float across)
{
    float steep = smoothstep(0.015, 0.25, fall);
    float bank = smoothstep(0.72, 0.98, abs(across));
    return clamp(0.0015 + 0.5 * steep + bank * (0.008 + 0.15 * steep), 0.0, 0.8);
}
