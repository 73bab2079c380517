"""The picture of the page on Poisson-disk points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.benchmarks.poisson_disk import PoissonDisk
from sketchterrain.vegetation.graded_poisson import GradedPoisson, SpacingRaster

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

_COLOURS = ("#333333", "#0072B2", "#009E73", "#D55E00")
_LEAST = 1 << 14  # lattice units
_WIDE = 24  # distances that the pictures are wide


def draw_points(context: ComputeContext) -> Any:
    """Draw points at one distance by their level, and points whose distance grows eastward."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    one, graded = figure.subplots(1, 2)
    radius = _LEAST
    area = (0, 0, _WIDE * radius, _WIDE * radius)
    points = PoissonDisk(context, radius, seed=4, levels=3).within(area)
    for level, colour in enumerate(_COLOURS):
        own = points.position[points.level == level] / radius
        one.scatter(own[:, 0], own[:, 1], 5.0 * 1.7**level, colour, linewidths=0.0, label=f"level {level}")
    one.set(title="one distance, with levels", xlabel="distances", xlim=(0.0, _WIDE), ylim=(0.0, _WIDE))
    found = GradedPoisson(context, _growing, least=radius, most=8 * radius, levels=1, seed=4).within(area)
    place, spacing = np.stack([found["x"], found["y"]], axis=-1) / radius, found["spacing"] / radius
    for at, apart in zip(place, spacing, strict=True):
        graded.add_patch(Circle(at, apart / 2.0, facecolor=_COLOURS[1], alpha=0.25, linewidth=0.0))
    graded.scatter(place[:, 0], place[:, 1], 3.0, _COLOURS[0], linewidths=0.0)
    graded.set(title="distances of 1 to 4: no two discs overlap", xlabel="least distances")
    graded.set(xlim=(0.0, _WIDE), ylim=(0.0, _WIDE))
    for axes in (one, graded):
        axes.set_aspect("equal")
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return figure


def _growing(west: int, south: int, east: int, north: int) -> SpacingRaster:
    """Return a distance that grows from 1 to 4 of 2^14 lattice units over _WIDE of them."""
    step = 1 << 13
    column, row = west // step, south // step
    x = np.arange(column, -(-east // step) + 1) * (step / _LEAST)
    spacing = _LEAST * (1.0 + 3.0 * np.clip(x / _WIDE, 0.0, 1.0)) * np.ones((-(-north // step) + 1 - row, 1))
    return SpacingRaster(column * step, row * step, step, spacing.astype(np.float32))
