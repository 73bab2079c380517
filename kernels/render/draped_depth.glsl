// Depth test of what is draped. Include after frame.glsl and nearest_sample.glsl.
const float NEARER = 0.002; // share of the distance within which the ground does not hide what lies on it

// Distance along the view direction (m) of a depth.
float distance_of(float depth)
{
    return 1.0 / (from_clip[2].w * (2.0 * depth - 1.0) + from_clip[3].w);
}

// Whether the ground in this fragment's pixel hides it.
bool is_hidden(sampler2D ground_depth)
{
    float depth, away = 1.0 / gl_FragCoord.w;
    nearest_sample(ground_depth, ivec2(gl_FragCoord.xy), depth);
    return away > distance_of(depth) * (1.0 + NEARER) + fwidth(away);
}
