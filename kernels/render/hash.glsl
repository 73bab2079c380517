// Hash of an integer: Wellons' lowbias32, as in kernels/hash.clh.
uint hash32(uint h)
{
    h = (h ^ (h >> 16)) * 0x7feb352du;
    h = (h ^ (h >> 15)) * 0x846ca68bu;
    return h ^ (h >> 16);
}
