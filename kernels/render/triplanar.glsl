// Which planes a surface is textured from (Zaaijer 2013, §5.3): the weight of an axis rises from 0 where the
// normal is 55° away from it to 1 where it is 35° away.
vec3 triplanar_weights(vec3 normal)
{
    vec3 w = smoothstep(vec3(0.57357644), vec3(0.81915204), abs(normal));
    return w / max(w.x + w.y + w.z, 1e-4);
}
