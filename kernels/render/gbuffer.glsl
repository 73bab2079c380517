// Depths of the G-buffer. Include after frame.glsl.
//   SAMPLES  along each axis of a pixel

// The sample of a pixel that is nearest to the eye, which is shaded for all of them.
ivec2 nearest_sample(sampler2D depths, ivec2 pixel, out float depth)
{
    ivec2 nearest = pixel * SAMPLES;
    depth = 1.0;
    for (int k = 0; k < SAMPLES * SAMPLES; ++k) {
        ivec2 at = pixel * SAMPLES + ivec2(k % SAMPLES, k / SAMPLES);
        float d = texelFetch(depths, at, 0).r;
        nearest = d < depth ? at : nearest;
        depth = min(d, depth);
    }
    return nearest;
}

// Position of a sample, m from the eye.
vec3 position_of(sampler2D depths, ivec2 at, float depth)
{
    vec2 size = vec2(textureSize(depths, 0));
    vec4 unprojected = from_clip * vec4(vec3((vec2(at) + 0.5) / size, min(depth, 0.9999999)) * 2.0 - 1.0, 1.0);
    return unprojected.xyz / unprojected.w;
}

// Distance along the view direction (m) of a depth.
float distance_of(float depth)
{
    return 1.0 / (from_clip[2].w * (2.0 * depth - 1.0) + from_clip[3].w);
}

const float NEARER = 0.002; // share of the distance within which the ground does not hide what lies on it

// Whether the ground in this fragment's pixel hides it.
bool is_hidden(sampler2D depths)
{
    float depth, away = 1.0 / gl_FragCoord.w;
    nearest_sample(depths, ivec2(gl_FragCoord.xy), depth);
    return away > distance_of(depth) * (1.0 + NEARER) + fwidth(away);
}
