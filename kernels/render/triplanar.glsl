// Weights of the texture planes (Zaaijer 2013, §5.3): an axis' weight rises from 0 at 55° between it and the normal
// to 1 at 35°.
vec3 triplanar_weights(vec3 normal)
{
    vec3 w = smoothstep(vec3(0.57357644), vec3(0.81915204), abs(normal));
    return w / max(w.x + w.y + w.z, 1e-4);
}
