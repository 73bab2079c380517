"""Quality levels of pictures, time budgets of frames, and statistics."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from typing import Final, TypeVar

import numpy as np

from sketchterrain.errors import InputError

_OVERHEAD: Final = 0.0004  # s of any piece of work, however small
_SMOOTHING: Final = 0.3  # weight of one fast measurement; a slow one replaces the estimate at once
_OPTIMISM: Final = 0.9  # factor of the estimate after a refusal with (almost) the whole budget left
_WHOLE_BUDGET: Final = 0.8  # share of the largest recent budget that counts as all of it
_BUDGET_DECAY: Final = 0.95  # factor of the largest recent budget from query to query: budgets may shrink


class TimeBudget:
    """Seconds that remain of a frame's budget, counted from construction."""

    def __init__(self, seconds: float, *, timer: Callable[[], float] = time.perf_counter) -> None:
        self._seconds = seconds
        self._timer = timer
        self._start = timer()

    @property
    def spent(self) -> float:
        """Seconds since the start."""
        return self._timer() - self._start

    @property
    def left(self) -> float:
        """Remaining seconds, at least 0."""
        return max(self._seconds - self.spent, 0.0)

    def fraction(self, share: float) -> TimeBudget:
        """Return a budget of a share of the remaining time."""
        return TimeBudget(share * self.left, timer=self._timer)


UNLIMITED: Final = TimeBudget(np.inf)


class WorkRate:
    """Estimated seconds per unit of one kind of work, updated from measurements."""

    def __init__(self, unit: float) -> None:
        self.unit = unit
        self._fastest = unit
        self._largest_budget = 0.0

    def steps_within(self, budget: TimeBudget, count: int, *, step: int = 1) -> int:
        """Return how many of `count` steps of `step` units are expected to fit into the remaining time.

        If none fits although the budget is as large as it gets, the estimate is lowered: one slow measurement
        must not stop the work for ever.
        """
        left = budget.left
        if left == np.inf:
            return count
        self._largest_budget = max(left, _BUDGET_DECAY * self._largest_budget)
        steps = max(int((left - _OVERHEAD) / (self.unit * step)), 0)
        if not steps and left > max(2.0 * _OVERHEAD, _WHOLE_BUDGET * self._largest_budget):
            self.unit = max(_OPTIMISM * self.unit, self._fastest)
        return min(steps, count)

    def record(self, units: int, seconds: float) -> None:
        """Update the estimate from a measured piece of work."""
        unit = max(seconds - _OVERHEAD, 0.1 * seconds, 1e-9) / units
        self.unit = unit if unit > self.unit else (1.0 - _SMOOTHING) * self.unit + _SMOOTHING * unit
        self._fastest = min(self._fastest, self.unit)

    def run(self, budget: TimeBudget, work: Callable[[int], object], *, count: int, step: int = 1) -> int:
        """Execute up to `count` steps (of `step` units) within the budget; return their number."""
        steps = self.steps_within(budget, count, step=step)
        if steps:
            before = budget.spent
            work(steps)
            self.record(steps * step, budget.spent - before)
        return steps


@dataclass(frozen=True)
class StreamStats:
    """Statistics of the tiles of one frame."""

    generation_seconds: float  # including waiting for the device
    tiles_generated: int
    tiles_drawn: int
    triangles: int
    complete: bool  # no tile in sight is missing
    converged: bool  # no tile is missing or morphing
    jumped: bool  # the eye jumped, and the frame got a larger budget


@dataclass(frozen=True)
class FrameStats(StreamStats):
    """Statistics of one frame of a moving picture; `triangles` are those of terrain and plants.

    It has `converged` if nothing is missing: only water and plants move.
    """

    light_seconds: float  # for parts of the light maps
    plant_seconds: float  # for plants and their shadow maps
    draw_seconds: float
    drape_seconds: float  # of those, for draped layers that tiles don't show
    size: tuple[int, int]  # of the internal picture (px); smaller than the framebuffer during motion


PARTS: Final = ("shadows", "clouds", "haze", "water", "trees", "rocks", "grass", "detail")
"""Optional parts of a picture; ``detail`` is relief and fine structure of textures."""

CPU_DRIVERS: Final = ("llvmpipe", "softpipe", "swrast", "swiftshader", "basic render", "gdi generic")
"""Substrings of the names of CPU drivers."""
SHARED_MEMORY: Final = ("intel", "mali", "adreno", "videocore", "apple")
"""Substrings of the names of GPUs that share the CPU's memory."""
STILL_TILES: Final = (128 << 20, 512 << 20)
"""Bytes for the tiles of a still of 1280 × 720 pixels, and at most."""
STILL_APPEARANCE, MOST_APPEARANCE = 482, 2048  # appearance tiles of such a still, and at most
STILL_QUADS: Final = 32
"""Quads along their sides: a third fewer triangles than with 64, which take less planning in motion."""
ON_CPU: Final = 0.1
ON_SHARED: Final = 0.5
ON_CARD: Final = 0.8
_LEVELS: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
_COVER_LEVELS: Final = (0.3, 0.5, 1.0)  # no ground cover below the first

_Value = TypeVar("_Value")


def _by_level(value: Callable[[float], _Value]) -> _Value:
    """Declare a limit by its value at each level; the default is that of the best one."""
    declared: _Value = field(default=value(1.0), metadata={"value": value})
    return declared


def _interpolated(*values: float) -> float:
    """Declare a limit by values at `_LEVELS`, geometrically interpolated."""
    return _by_level(lambda level: _geometric(level, values))


def _geometric(level: float, values: tuple[float, ...]) -> float:
    return round(float(np.exp(np.interp(level, _LEVELS, np.log(values)))), 6)


def _stepped(least: int, *steps: tuple[float, int]) -> int:
    """Declare a limit by its value at level 0, and by others from some levels on."""
    return _by_level(lambda level: [least, *(value for start, value in steps if level >= start)][-1])


@dataclass(frozen=True)
class Quality:
    """Cost limits of pictures and of frames of moving pictures, derived from one level by `from_level`.

    Terrain shading reads 2 material texels a pixel at level 0, and mostly 12 to 24, at most 72, at level 1.
    From 0.75 on pictures are complete.
    """

    # Shape is the last to give way: mountains keep their ridges and rock at any quality.
    tolerance: float = _interpolated(
        1.6, 1.3, 1.2, 1.1, 1.0
    )  # τ: deviation of the terrain, px of the picture
    neighbour_limit: float = _interpolated(5.0, 4.5, 4.0, 2.8, 2.0)
    """Error of a parent along a coarser neighbour, in tolerances."""
    finest_quad: float = _interpolated(3.0, 2.5, 1.5, 1.2, 1.0)  # px, width of quads that are not split
    appearance_tiles: int = _stepped(241, (0.5, 482))  # of what vectors paint, in memory, of 147 KB ...
    appearance_taps: int = _stepped(2, (0.5, 4), (0.75, 8))  # ... and most samples along a pixel's footprint
    draw_distance: float = 7.0  # at the terrain, extents; grows with the eye's height
    samples: int = _stepped(1, (0.75, 2))  # visibility samples a pixel along each axis (shading takes one)
    materials: int = _stepped(
        1, (0.4, 2), (0.75, 3)
    )  # blended ones a pixel, shade_ground.frag.glsl; with ...
    planes: int = _stepped(1, (0.5, 2))  # ... texture planes, ...
    octaves: int = _stepped(1, (0.5, 2))  # ... texture scales ...
    hexes: int = _stepped(1, (0.5, 3))  # ... and hexagons, which hide the repetition
    material_texels: int = _stepped(512, (0.5, 1024))  # side of material textures, a power of two
    map_texels: int = _by_level(lambda level: 64 * round(4.0 + 8.0 * level))
    """Side of the height maps for shadows and sky visibility, a multiple of 64."""
    light_maps: int = _stepped(2, (0.5, 3))  # maps of the light on the terrain: far and near, and close
    cloud_steps: int = _by_level(lambda level: 64 + round(32 * level))  # of a ray through the clouds
    cloud_texels: int = _stepped(768, (0.5, 0))  # side of the dome; 0: clouds are computed in each picture
    shade_maps: int = _stepped(0, (0.2, 1), (0.5, 2))  # shadow maps of plants: none, far, far and near
    shade_texels: int = _stepped(1024, (0.5, 2048))  # their side
    surface_texels: int = _stepped(256, (0.4, 512), (0.75, 1024))  # side of both squares of the surface map
    plant_distance: float = 2400.0  # draw distance of plants, m
    canopy_distance: float = _interpolated(250.0, 400.0, 1000.0, 1550.0, 2400.0)
    """Distance (m) beyond which the ground of dense forests has their canopy's colour."""
    plant_lod_scale: float = _interpolated(0.15, 0.25, 0.6, 0.77, 1.0)
    """Scale of the heights (px) at which plants switch to finer meshes."""
    thinning_pixels: float = _interpolated(10.0, 9.0, 8.0, 6.0, 4.0)
    """Height (px of the whole picture) below which forests are thinned out."""
    max_plants: int = _by_level(lambda level: round(_geometric(level, (4e3, 8e3, 3e4, 6e4, 1.2e5))))
    """Most plant instances in a picture."""
    grass_distance: float = _by_level(
        lambda level: float(np.interp(level, _COVER_LEVELS, (30.0, 60.0, 110.0), left=0.0))
    )
    """Draw distance of grass, m; boulders in proportion; 0: none."""
    ground_cover_density: float = _by_level(
        lambda level: float(np.interp(level, _COVER_LEVELS, (0.3, 0.55, 1.0)))
    )
    """Density of ground cover over the best quality's; blades are widened to match."""
    moving_scale: float = _interpolated(0.22, 0.3, 0.5, 0.7, 1.0)
    """Least side of the picture over the whole one's until that is complete."""
    quads: int = _stepped(16, (0.25, 32), (0.5, 64))  # along the side of a tile
    tile_memory: int = _by_level(lambda level: round((128 << 20) * 4.0**level))  # bytes for tiles
    budget: float = _by_level(lambda level: 0.006 + 0.004 * level)
    """Seconds per frame for new tiles, light and plants; see `Renderer.frame`."""
    without: frozenset[str] = frozenset()  # omitted parts, names of `PARTS`

    def __post_init__(self) -> None:
        for name in sorted(self.without):
            if name not in PARTS:
                raise InputError(f"expected a part of a picture, one of {', '.join(PARTS)}, got {name!r}")

    def includes(self, part: str) -> bool:
        """Return whether a part of `PARTS` is drawn."""
        return part not in self.without

    @classmethod
    def from_level(cls, level: float, *, without: Iterable[str] = ()) -> Quality:
        """Return the quality of a level from 0 (cheapest) to 1 (best)."""
        if not 0.0 <= level <= 1.0:
            raise InputError(f"expected a quality from 0 to 1, got {level:g}")
        values = {each.name: each.metadata["value"](level) for each in fields(cls) if each.metadata}
        return cls(**values, without=frozenset(without))

    @classmethod
    def for_still(cls, size: tuple[int, int]) -> Quality:
        """Return the best quality, with memory for the tiles that a still of a size (px) shows."""
        least, most = STILL_TILES
        pixels = size[0] * size[1]
        memory = min(max(least * pixels // (1280 * 720), least), most)
        painted = min(max(STILL_APPEARANCE * pixels // (1280 * 720), STILL_APPEARANCE), MOST_APPEARANCE)
        return cls(quads=STILL_QUADS, tile_memory=memory, appearance_tiles=painted)

    @classmethod
    def for_renderer(cls, name: str) -> Quality:
        """Return the quality for a driver's ``GL_RENDERER``.

        A machine without a GPU gets what two cores draw at 20 frames a second and 1280×720.
        """
        low = name.lower()
        if any(part in low for part in CPU_DRIVERS):
            return cls.from_level(ON_CPU)
        return cls.from_level(ON_SHARED if any(part in low for part in SHARED_MEMORY) else ON_CARD)
