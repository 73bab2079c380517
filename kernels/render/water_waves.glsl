// Waves from one texture laid at several sizes, drifting with the wind and advected by the stream. Oracle: sketchterrain/render/water.py and tests/render/test_water.py.
//
// The texture holds slopes and their square, each averaged in its mipmaps: unresolved slopes become
// roughness (Olano & Baker 2010; Bruneton et al. 2010, section 4.1).
// WAVES: how many sizes.
uniform sampler2D wave_slopes;     // rg: slope of one size, mean 0, mean of the squared length 1; b: that square; a: height
uniform vec4 wave_layers[WAVES];   // xy: texture's x axis over its period, 1/m; z, w: root of its share of slope² inland, and at sea
uniform vec2 wave_phases[WAVES];   // the eye's position in the texture, including drift

const float RENEWAL = 3.2;     // s, after which an advected pattern restarts
const float FINEST_WAVES = 0.00006; // slope² along one axis that is never resolved: capillary waves of calm water
const vec2 BAND = vec2(3.0, 56.0); // longest and shortest waves, per period of the texture (render/water.py)

struct Waves {
    vec2 slope;
    float variance; // along one axis, of unresolved waves
    float resolved; // and of the others
};

// Speed across a stream over that in its middle; `across` is 1 at the bank.
float stream_profile(float across)
{
    float x = min(abs(across), 1.0);
    return 1.0 - x * x * x;
}

// Age (s) of an advected pattern in one of two phases, and its weight. The weights' squares sum to 1, so that the mixture
// is as rough as each (Heitz & Neyret 2018, section 3); a weight is 0 where its pattern restarts.
//   time     in renewals
vec2 flow_phase(float time, float phase)
{
    float t = fract(time + 0.5 * phase);
    float w = 1.0 - abs(2.0 * t - 1.0);
    return vec2((t - 0.5) * RENEWAL, w * inversesqrt(w * w + (1.0 - w) * (1.0 - w)));
}

// Length (m) of the dominant waves that a wind (m/s) raises over a fetch (m) (JONSWAP, Hasselmann et al. 1973): their
// frequency is 3.5 g/U (g F/U²)^(-1/3).
float longest_wave(float speed, float fetch) { return 0.00607 * pow(max(speed * fetch, 1e-3), 2.0 / 3.0); }

//   place      m from the eye
//   velocity   of the stream, m/s
//   pixel      width of a pixel on the water, m
//   roughness  slope² of all waves, both axes together
//   time       in renewals
//   longest    wave, m: each layer has its share of octaves of shorter ones; negative at sea, whose shares are its own
Waves waves_at(vec2 place, vec2 velocity, float pixel, float roughness, float time, float longest)
{
    Waves all = Waves(vec2(0.0), FINEST_WAVES, 0.0);
    float texels = float(textureSize(wave_slopes, 0).x);
    for (int i = 0; i < WAVES; ++i) {
        vec4 layer = wave_layers[i];
        float octaves = log2(max(longest, 1e-3) * length(layer.xy) * BAND.y) / log2(BAND.y / BAND.x);
        float share = longest < 0.0 ? layer.w : layer.z * sqrt(clamp(octaves, 0.0, 1.0));
        if (share == 0.0) continue;
        mat2 turn = mat2(layer.x, -layer.y, layer.y, layer.x); // m -> texture, columns
        float lod = log2(max(pixel * length(layer.xy) * texels, 1e-3));
        vec3 sum = vec3(0.0);
        for (int phase = 0; phase < 2; ++phase) {
            vec2 flow = flow_phase(time, float(phase));
            vec2 at = turn * (place - velocity * flow.x) + wave_phases[i] + 0.37 * float(phase);
            vec3 read = textureLod(wave_slopes, at, lod).rgb;
            float spread = max(read.b - dot(read.rg, read.rg), 0.0);
            sum += vec3(flow.y * read.rg, flow.y * flow.y * spread);
        }
        float height = sqrt(roughness) * share;
        vec2 axis = layer.xy / length(layer.xy);
        all.slope += height * (mat2(axis.x, axis.y, -axis.y, axis.x) * sum.xy);
        all.variance += 0.5 * height * height * sum.z;
        all.resolved += 0.5 * height * height * max(1.0 - sum.z, 0.0);
    }
    return all;
}
