// Distance along the view direction (m) of a depth. Include after frame.glsl.
float distance_of(float depth)
{
    return 1.0 / (from_clip[2].w * (2.0 * depth - 1.0) + from_clip[3].w);
}

const float NEARER = 0.002; // share of the distance within which the ground does not hide what lies on it

// Whether the nearest of SAMPLES² samples of the ground in this fragment's pixel hides it.
bool is_hidden(sampler2D ground_depth)
{
    ivec2 pixel = ivec2(gl_FragCoord.xy) * SAMPLES;
    float depth = 1.0, away = 1.0 / gl_FragCoord.w;
    for (int k = 0; k < SAMPLES * SAMPLES; ++k)
        depth = min(depth, texelFetch(ground_depth, pixel + ivec2(k % SAMPLES, k / SAMPLES), 0).r);
    return away > distance_of(depth) * (1.0 + NEARER) + fwidth(away);
}
