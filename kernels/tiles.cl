// Patches whose vertices lie whole powers of two of lattice units apart: tiles, and rasters that are made of them.
#define PATCH_POSITIONS
#include "patches.clh"
