"""The distance to a spline by each method as a picture, with its failures.

``python -m sketchterrain.benchmarks.spline_picture FILE`` draws it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import binary_dilation

from sketchterrain.benchmarks.spline_cases import distances
from sketchterrain.benchmarks.spline_methods import ARCS, KERNELS, SEGMENTS, SplineQueries
from sketchterrain.benchmarks.splines import failures
from sketchterrain.compute.context import ComputeContext
from sketchterrain.hydrology.splines import catmull_rom

if TYPE_CHECKING:
    import numpy.typing as npt

CONTROLS = np.array(
    [
        [-150, -50],
        [-110, 55],
        [-70, -20],
        [-66, 60],
        [30, 75],
        [35, 68],
        [-30, 10],
        [70, -75],
        [140, 40],
        [95, 50],
    ],
    dtype=np.float64,
)
"""A bend, a hairpin narrower than a river, two points that all but coincide, a wide loop (m)."""

_HALF_EAST, _HALF_NORTH, _STEP = 190.0, 120.0, 0.8
_CELL = 2.0


def draw_fields(context: ComputeContext) -> Any:
    """Return a figure: a panel a method, its distances as steps of 10 m, its failures in orange."""
    from matplotlib.figure import Figure

    x = np.arange(-_HALF_EAST, _HALF_EAST + _STEP, _STEP)
    y = np.arange(-_HALF_NORTH, _HALF_NORTH + _STEP, _STEP)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(1, -1, 2)
    queries = SplineQueries(context, CONTROLS[None], places)
    expected = distances(queries.cubics, queries.places)
    curve = catmull_rom(CONTROLS, np.linspace(0, len(CONTROLS) - 1, 1000))
    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    for axes, method in zip(figure.subplots(2, 3).ravel(), KERNELS, strict=True):
        found = queries.distances(method, _CELL)
        failed = failures(np.abs(found - expected), _CELL)
        _panel(axes, (x, y), found.reshape(y.size, x.size), failed.reshape(y.size, x.size), curve)
        flattened = f", cells of {_CELL:g} m" if method in (SEGMENTS, ARCS) else ""
        share = f"{100 * failed.mean():.1f} % wrong" if failed.any() else "never wrong"
        axes.set_title(f"{method}{flattened}: {share}", loc="left", fontsize=9.5, fontweight="bold")
    return figure


def _panel(
    axes: Any,
    at: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]],
    found: npt.NDArray[Any],
    failed: npt.NDArray[np.bool_],
    curve: npt.NDArray[np.float64],
) -> None:
    x, y = at
    extent = (x[0], x[-1], y[0], y[-1])
    levels = np.arange(0.0, 200.0, 10.0)
    axes.contourf(x, y, found, levels=levels, cmap="Blues_r", vmin=0.0, vmax=140.0, antialiased=False)
    red = np.zeros((*failed.shape, 4))
    # A step wider, so that thin lines show.
    red[..., 0], red[..., 1], red[..., 3] = 0.84, 0.37, 0.85 * binary_dilation(failed)
    axes.imshow(red, extent=extent, origin="lower", zorder=1.5)
    axes.plot(*curve.T, color="black", linewidth=1.2)
    axes.plot(*CONTROLS.T, "o", color="black", markersize=2.5)
    axes.set(xticks=[], yticks=[], xlim=extent[:2], ylim=extent[2:])


if __name__ == "__main__":
    draw_fields(ComputeContext()).savefig(Path(sys.argv[1]), dpi=100)
