"""Relief, slopes, hypsometry and materials of a written world, in one pass over it and bounded memory."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.world.grid import CHUNK
from sketchterrain.world.sums import Sums

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.world.grid import Level
    from sketchterrain.world.opening import StoredWorld

__all__ = ["QUANTILES", "Hypsometry", "Relief", "Slopes", "Statistics", "statistics_of"]

QUANTILES: Final = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
_STRIPE: Final = 16 * CHUNK  # columns that are read together, with one more on either side
_CLASSES: Final = 20
_SLOPE_CLASS: Final = 5  # degrees
_THREADS: Final = 4


@dataclass(frozen=True)
class Relief:
    """Heights, m. All are exact but the quantiles, which are known to a 65,536th of the range.

    Attributes
    ----------
    lowest, highest, mean, deviation : float
        The last is the standard deviation.
    quantiles : dict of float to float
        By the share of vertices that lie lower.
    """

    lowest: float
    highest: float
    mean: float
    deviation: float
    quantiles: dict[float, float]


@dataclass(frozen=True)
class Slopes:
    """Slopes, degrees, by the weighted differences of Horn (1981), at all vertices but the outermost.

    Attributes
    ----------
    mean, steepest : float
    quantiles : dict of float to float
        By the share of vertices that are flatter; to a hundredth of a degree.
    shares : tuple of float
        Of the vertices, in classes of 5° from 0°.
    surface : float
        The surface's area for that of its map, at least 1.
    """

    mean: float
    steepest: float
    quantiles: dict[float, float]
    shares: tuple[float, ...]
    surface: float


@dataclass(frozen=True)
class Hypsometry:
    """How much of the area lies above which height (Strahler 1952).

    Attributes
    ----------
    heights, above : tuple of float
        m, from the lowest to the highest in 20 equal steps; the share of the area that lies above.
    integral : float
        The area under that curve, both axes from 0 to 1: (mean − lowest) / range, which is the same
        (Pike and Wilson 1971). 0.5 where the ground is flat.
    """

    heights: tuple[float, ...]
    above: tuple[float, ...]
    integral: float


@dataclass(frozen=True)
class Statistics:
    """What one level of a world holds.

    Attributes
    ----------
    level : Level
    area : float
        m² that its vertices span.
    relief : Relief
    slopes : Slopes or None
        None where the level has no vertex with neighbours all around.
    hypsometry : Hypsometry
    materials : dict of str to float
        Share of each of the whole; empty where none are written.
    """

    level: Level
    area: float
    relief: Relief
    slopes: Slopes | None
    hypsometry: Hypsometry
    materials: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        relief, slopes, hypsometry = self.relief, self.slopes, self.hypsometry
        return {
            "level": self.level.number,
            "cell": self.level.cell,
            "columns": self.level.columns,
            "rows": self.level.rows,
            "area": self.area,
            "relief": {
                "minimum": relief.lowest,
                "maximum": relief.highest,
                "range": relief.highest - relief.lowest,
                "mean": relief.mean,
                "standard_deviation": relief.deviation,
                "quantiles": {f"{share:g}": value for share, value in relief.quantiles.items()},
            },
            "slopes": None
            if slopes is None
            else {
                "unit": "degrees",
                "method": "Horn 1981",
                "mean": slopes.mean,
                "maximum": slopes.steepest,
                "quantiles": {f"{share:g}": value for share, value in slopes.quantiles.items()},
                "class": _SLOPE_CLASS,
                "shares": list(slopes.shares),
                "surface_ratio": slopes.surface,
            },
            "hypsometry": {
                "integral": hypsometry.integral,
                "heights": list(hypsometry.heights),
                "share_above": list(hypsometry.above),
            },
            "materials": self.materials,
        }


def statistics_of(
    stored: StoredWorld, *, level: int = 0, progress: Callable[[float], None] | None = None
) -> Statistics:
    """Measure one level of a world.

    The same numbers on every machine: stripes are measured by several threads, and put together in order.

    Parameters
    ----------
    stored
    level
        Its number; 0 is the finest.
    progress
        Called with the share that is done, 0 … 1.

    Raises
    ------
    InputError
        If there is no such level, or some of it is missing or broken.
    """
    there = [each.number for each in stored.levels]
    if level not in there:
        raise InputError(f"no level {level}: expected {there[0]} to {there[-1]}")
    chosen = stored.levels[there.index(level)]
    names = stored.material_names if "materials" in stored.layers else ()
    total = Sums(chosen.cell, len(names))
    stripes = range(0, chosen.columns, _STRIPE)
    with ThreadPoolExecutor(min(_THREADS, os.cpu_count() or 1), thread_name_prefix="statistics") as pool:
        parts = [pool.submit(_stripe, stored, chosen, left, len(names)) for left in stripes]
        try:
            for number, part in enumerate(parts, start=1):
                total.add(part.result())
                if progress is not None:
                    progress(number / len(parts))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    return _told(chosen, total, names)


def _stripe(stored: StoredWorld, level: Level, left: int, materials: int) -> Sums:
    """Measure some columns, from the north on: a chunk's rows at a time, and two from those before."""
    sums = Sums(level.cell, materials)
    columns = min(_STRIPE, level.columns - left)
    first, last = max(left - 1, 0), min(left + columns + 1, level.columns)
    before = np.empty((0, last - first), np.float32)
    for top in range(0, level.rows, CHUNK):
        rows = min(CHUNK, level.rows - top)
        window = {"top": top, "rows": rows}
        height = stored.read("height", level.number, left=first, columns=last - first, **window)
        sums.add_heights(height[:, left - first : left - first + columns])
        joined = np.concatenate([before, height])
        sums.add_slopes(joined)
        before = joined[-2:]
        if materials:
            sums.add_materials(stored.read("materials", level.number, left=left, columns=columns, **window))
    return sums


def _told(level: Level, sums: Sums, names: tuple[str, ...]) -> Statistics:
    lowest, highest = sums.lowest, sums.highest
    relief = Relief(
        lowest, highest, sums.mean, sums.deviation, {share: sums.height_at(share) for share in QUANTILES}
    )
    steps = np.linspace(lowest, highest, _CLASSES + 1)
    above = tuple(1.0 - sums.share_below(float(height)) for height in steps)
    flat = highest <= lowest
    integral = 0.5 if flat else (sums.mean - lowest) / (highest - lowest)
    slopes = None
    if sums.slope_count:
        shares = sums.slope_shares(_SLOPE_CLASS)
        quantiles = {share: sums.slope_at(share) for share in QUANTILES}
        slopes = Slopes(sums.slope_mean, sums.steepest, quantiles, shares, sums.surface)
    return Statistics(
        level,
        (level.columns - 1) * (level.rows - 1) * level.cell**2,
        relief,
        slopes,
        Hypsometry(tuple(float(step) for step in steps), above, integral),
        dict(zip(names, sums.material_shares, strict=True)),
    )
