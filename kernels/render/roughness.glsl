// Roughness filtered by the variance of slopes in each direction: α² of the Trowbridge-Reitz distribution grows by twice
// the variance (Kaplanyan et al. 2016, §3; Olano & Baker 2010, eq. 6), roughness is √α. As `filtered_roughness` in look/.
float filtered_roughness(float roughness, float variance)
{
    float square = roughness * roughness;
    return sqrt(sqrt(min(square * square + 2.0 * variance, 1.0)));
}
