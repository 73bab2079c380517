"""Spectra as a picture: points, periodogram, power, anisotropy of darts, this program, the thesis's way.

``python -m sketchterrain.benchmarks.spectrum_picture FILE`` draws it, twenty sets a row.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from PIL import Image

from sketchterrain.benchmarks.baselines.dart_thrower import throw_darts
from sketchterrain.benchmarks.baselines.phase_groups import PhaseGroups
from sketchterrain.benchmarks.point_ways import own
from sketchterrain.benchmarks.spectrum import HIGHEST, LOWEST, SETS, SIDE, spectrum_of
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.io.files import write_atomic
from sketchterrain.vegetation.poisson import TRIALS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy.typing as npt

    from sketchterrain.benchmarks.spectrum import Spectrum

    Points = npt.NDArray[np.float64]

_AROUND: Final = 8.0  # distances that the sets are wider than the square that is measured
_SHOWN: Final = 20.0  # distances across the points that are drawn
_TRIALS: Final = 4  # of the thesis's way
_BRIGHTEST: Final = 2.0
_POOLED: Final = 2  # frequencies a pixel, either way
_IDEAL, _ASKED = -10.0 * np.log10(SETS), -11.0  # dB
_INK, _OWN, _GREY, _ALARM = "#333333", "#0072B2", "#BBBBBB", "#D55E00"


def ways(context: TimedContext) -> Mapping[str, Callable[[int], Points]]:
    """Return the rows: names, and what gives the points of a seed."""
    side = SIDE + _AROUND
    program = own(context, side, TRIALS)
    thesis = PhaseGroups(context, side, 1.0, _TRIALS)
    plain = PhaseGroups(context, side, 1.0, _TRIALS, levels=1)
    return {
        "darts one after another, float64": lambda seed: throw_darts(side, seed=seed),
        f"this program, {TRIALS} darts a cell": lambda seed: program.run(seed)[1],
        f"the thesis's way, k = {_TRIALS}": lambda seed: thesis.points(seed).astype(np.float64),
        "phase groups without levels": lambda seed: plain.points(seed).astype(np.float64),
    }


def draw_spectra(sets: Mapping[str, list[Points]]) -> Any:
    """Draw a row for each way.

    Parameters
    ----------
    sets
        Name, and points of each set in distances; the first one is what the others are held against.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 2.95 * len(sets)), layout="constrained")
    grid = figure.subplots(len(sets), 4, squeeze=False, width_ratios=(1.0, 1.0, 1.25, 1.25))
    found = {name: spectrum_of(points) for name, points in sets.items()}
    reference = next(iter(found.values()))
    for row, (name, points), spectrum in zip(grid, sets.items(), found.values(), strict=True):
        _points(row[0], points[0], name)
        _plane(row[1], spectrum)
        _power(row[2], spectrum, reference)
        _anisotropy(row[3], spectrum)
    for axes in grid[-1, 1:]:
        axes.set_xlabel("waves a distance", fontsize=8.0)
    for axes in grid.ravel():
        axes.tick_params(labelsize=7.5)
    return figure


def _points(axes: Any, points: Points, name: str) -> None:
    shown = points[(points < _SHOWN).all(axis=1)]
    axes.plot(*shown.T, "o", color=_INK, markersize=2.2, markeredgewidth=0.0)
    axes.set(xlim=(0, _SHOWN), ylim=(0, _SHOWN), aspect="equal", xticks=[], yticks=[])
    axes.set_title(name, loc="left", fontsize=9.5, fontweight="bold")


def _plane(axes: Any, spectrum: Spectrum) -> None:
    side = spectrum.plane.shape[0] // _POOLED
    pooled = spectrum.plane[: side * _POOLED, : side * _POOLED]
    pooled = pooled.reshape(side, _POOLED, side, _POOLED).mean(axis=(1, 3))
    extent = (-HIGHEST, HIGHEST, -HIGHEST, HIGHEST)
    axes.imshow(pooled, cmap="gray", vmin=0.0, vmax=_BRIGHTEST, extent=extent, origin="lower")
    axes.set_title(f"power, 0 to {_BRIGHTEST:g}", loc="left", fontsize=9.0)


def _power(axes: Any, spectrum: Spectrum, reference: Spectrum) -> None:
    axes.plot(reference.frequency, reference.power, color=_GREY, linewidth=2.6)
    axes.plot(spectrum.frequency, spectrum.power, color=_OWN, linewidth=1.0)
    axes.set(xlim=(0.0, HIGHEST), ylim=(0.0, 2.5))
    axes.set_title("radial power; grey: darts until none fits", loc="left", fontsize=9.0)


def _anisotropy(axes: Any, spectrum: Spectrum) -> None:
    decibels = 10.0 * np.log10(spectrum.anisotropy)
    middle, _, bands = spectrum.bands()
    axes.plot(spectrum.frequency, decibels, color=_OWN, linewidth=0.5, alpha=0.5)
    axes.plot(middle, bands, color=_OWN, linewidth=1.6)
    axes.axhline(_IDEAL, color=_INK, linestyle=":", linewidth=0.9)
    axes.axhline(_ASKED, color=_ALARM, linestyle=":", linewidth=0.9)
    axes.axvline(LOWEST, color=_GREY, linewidth=0.9)
    top = 0.0 if decibels.max() < 0.0 else 25.0
    axes.set(xlim=(0.0, HIGHEST), ylim=(-20.0, top))
    axes.set_title(f"anisotropy, worst band {spectrum.worst:.1f} dB", loc="left", fontsize=9.0)


def main(arguments: list[str], *, sets: int = SETS) -> int:
    """Write the picture, of so many sets a row, into the file that is named."""
    found = {
        name: [scatter(seed) - 0.5 * _AROUND for seed in range(sets)]
        for name, scatter in ways(TimedContext()).items()
    }
    stream = io.BytesIO()
    draw_spectra(found).savefig(stream, format="png", dpi=100)
    # Few greys make a small file, and none is missed.
    small = io.BytesIO()
    Image.open(stream).convert("RGB").quantize(48, dither=Image.Dither.NONE).save(small, "PNG", optimize=True)
    write_atomic(Path(arguments[0]), small.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
