// Roughness of a surface whose slopes scatter by a variance in each direction around their mean: α² of Trowbridge and
// Reitz's distribution grows by twice the variance (Kaplanyan et al. 2016, §3; Olano & Baker 2010, eq. 6). Roughness
// is √α. The same as `filtered_roughness` of look/texture_maker.py.
float filtered_roughness(float roughness, float variance)
{
    float square = roughness * roughness;
    return sqrt(sqrt(min(square * square + 2.0 * variance, 1.0)));
}
