// Patches whose vertices lie on given axes, anywhere: the kernels of tiles.cl.
#define AXIS_POSITIONS
#include "tiles.cl"
