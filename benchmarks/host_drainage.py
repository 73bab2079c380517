"""Samples of arguments for the loops of drainage, wetness, landforms' metrics and bends of rivers."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from sketchterrain.benchmarks.host_flow import ground
from sketchterrain.host.library import host_function
from sketchterrain.landforms.drainage import DrainageRasters

_SPACING = 20.0


def level(size: int) -> tuple[Any, ...]:
    """Return what a level is packed from: a domain with a gap, hollows, equal heights, and courses."""
    z = ground(size)
    domain = np.ones(z.shape, np.bool_)
    domain[: size // 3, : size // 4] = False
    base = np.where(np.indices(z.shape).min(0) == 0, np.round(z), np.nan)
    base[size // 2, -1] = -0.0
    # One course leads out, one ends on land.
    course = np.full(z.shape, -1, np.int32)
    down = np.arange(size - 2, 0, -1)
    course[down, size // 2] = (down - 1) * size + size // 2
    course[-2, size // 4 : size // 2 - 2] = (size - 2) * size + np.arange(size // 4, size // 2 - 2) + 1
    rain = np.full(z.shape, _SPACING * _SPACING)
    return np.abs(z) * 0.02, np.abs(z) % 0.9, rain, base, domain, course.ravel()


def empty_rasters(rows: int, columns: int) -> DrainageRasters:
    """Return the rasters that a level of so many nodes is packed into."""
    shape = rows + 2, columns + 2
    planes = np.zeros((11, *shape)), np.zeros((6, *shape), np.int32), np.zeros((2, *shape), np.int8)
    return DrainageRasters(_SPACING, 1.0 / 400.0, *planes)


def _pack_drainage(size: int) -> tuple[Any, ...]:
    packed, start = level(size), ground(size // 2 + 2)
    start[:, size // 4] = np.nan
    onto = np.where(ground(size) > 3.0, ground(size), packed[3])
    return empty_rasters(size, size), *packed, onto, start, 7, -3, 1, 3, -2


def _packed(size: int) -> DrainageRasters:
    arguments = _pack_drainage(size)
    host_function("pack_drainage")(*arguments)
    rasters: DrainageRasters = arguments[0]
    rasters.reals[4] = rasters.reals[5] > 0.0  # strata
    return rasters


def _routed(size: int) -> tuple[DrainageRasters, int]:
    """Return a level that has been routed, and the number of nodes in the order of flow."""
    rasters = _packed(size)
    return rasters, host_function("route_drainage")(rasters)


def _built(size: int) -> tuple[DrainageRasters]:
    rasters, count = _routed(size)
    host_function("integrate_drainage")(rasters, count)
    return (rasters,)


def _carve_barriers(size: int) -> tuple[Any, ...]:
    floor = np.full((size + 2, size + 2), -np.inf)
    floor[size // 2 :] = 0.0
    return *_routed(size), floor


def _drainage_shares(size: int) -> tuple[Any, ...]:
    return *_routed(size), np.pad((ground(size) > 0.0).astype(np.float64), 1)


def _outlet_ramps(size: int) -> tuple[Any, ...]:
    _, repose, _, base, domain, _ = level(size)
    return base, repose, domain, _SPACING, np.zeros((size, size))


def _coarsen_drainage(size: int) -> tuple[Any, ...]:
    rows, columns = size // 2, (size + 1) // 2
    fields = np.zeros((4, rows, columns)), np.zeros((rows, columns), np.bool_)
    return *level(size), 1, 0, *fields, np.zeros(rows * columns, np.int32), np.zeros((3, size**2), np.int32)


def _wetness(size: int) -> tuple[Any, ...]:
    z, area = ground(size), 400.0 * (1.0 + ground(size) ** 4)
    z[size // 3, : size // 2] = np.nan
    z[size // 2 :] *= 10.0
    return z, area, 2 * _SPACING, _SPACING, np.zeros(z.shape, np.float32), np.zeros((2, size + 2, size + 2))


def _geomorphons(size: int) -> tuple[Any, ...]:
    table = (np.arange(81, dtype=np.int8) % 10).reshape(9, 9)
    return ground(size), 10.0, 0.02, 24, table, np.zeros((size, size), np.int8), np.zeros((2, size))


def _key_saddles(size: int) -> tuple[Any, ...]:
    z = ground(size).ravel()
    scratch = np.zeros((2, z.size), np.int64)
    return size, z, np.argsort(-z, kind="stable"), 1.0, np.zeros(z.size), np.zeros(z.size), scratch


def _nearest_below(size: int) -> tuple[Any, ...]:
    turn = np.arange(size) % 16.0 / 16.0  # tight bends, of rational points of the circle
    ahead = np.stack([1.0 - turn**2, 2.0 * turn], axis=-1) / (1.0 + turn**2)[:, None]
    ahead *= np.where(np.arange(size) // 16 % 2, -1.0, 1.0)[:, None] * 5.0
    across = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1) / 5.0
    arc, width = 5.0 * np.arange(size), 10.0 + np.arange(size) % 7
    found = np.zeros(12 * size, np.int64), np.zeros(12 * size), np.zeros(12 * size)
    banks, normals = np.array([-1.6, -1.5, -1.0, 1.0, 1.5, 1.6]), np.stack([across, np.roll(across, -1, 0)])
    return np.cumsum(ahead, 0), arc, width, normals, banks, 4.0, *found, np.zeros((4 * size, 2))


SAMPLES: Final[dict[str, Callable[[int], tuple[Any, ...]]]] = {
    "pack_drainage": _pack_drainage,
    "run_drainage": lambda size: (_packed(size), 4),
    "route_drainage": lambda size: (_packed(size),),
    "accumulate_drainage": lambda size: (_routed(size)[0],),
    "integrate_drainage": _routed,
    "limit_slopes": _built,
    "sink_courses": _built,
    "carve_barriers": _carve_barriers,
    "relax_heights": _built,
    "drainage_shares": _drainage_shares,
    "outlet_ramps": _outlet_ramps,
    "coarsen_drainage": _coarsen_drainage,
    "wetness": _wetness,
    "geomorphons": _geomorphons,
    "key_saddles": _key_saddles,
    "nearest_below": _nearest_below,
}
"""Functions of fresh arguments by the side of a raster, or by the points of a line."""
