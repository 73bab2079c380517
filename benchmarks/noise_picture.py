"""Noise as pictures: its kinds, and how evenly its gradients spread.

``python -m sketchterrain.benchmarks.noise_picture FILE`` draws them.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.io.files import write_atomic
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.noise import NoiseStack, OctaveTable, fbm, gradients, octave_table

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array, LatticeArray


_EXTENT, _SEED = 4096.0, 7
_LONGEST, _GAIN = 512.0, 0.5
_SIDE, _STEP = 420, 5.0  # vertices, and metres between them
_CELLS = 1024  # along the side of the square whose gradients' power is shown
_BEND = 0.25  # wavelengths that the warp moves by
_RIDGE_WEIGHT, _RIDGE_EDGE = 1.5, 0.125
_BLUE = "#0072B2"


def draw_noise() -> Any:
    """Draw one octave, fBm, ridged multifractal, a domain warp, and the power of the gradients."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    unit = metres_per_unit(_EXTENT)
    step = np.rint(np.arange(_SIDE) * _STEP / unit).astype(np.int64)
    x, y = np.meshgrid(step, step)
    bend = [_BEND * _LONGEST / unit * fbm(_table(name, most=4), name, x, y) for name in ("warp_u", "warp_v")]
    moved = [np.rint(a + b).astype(np.int64) for a, b in zip((x, y), bend, strict=True)]
    pictures = {
        "one octave": fbm(_table("one", most=1), "one", x, y),
        "fBm, 7 octaves": fbm(_table("fbm"), "fbm", x, y),
        "ridged multifractal": _ridged(_table("ridged"), x, y),
        "fBm at places that noise has moved": fbm(_table("fbm"), "fbm", *moved),
    }
    for axes, (title, value) in zip(panels, pictures.items(), strict=False):
        axes.imshow(value, cmap="gray", origin="lower", extent=(0, _SIDE * _STEP, 0, _SIDE * _STEP))
        axes.set_title(title, loc="left", fontsize=10.0)
        axes.set_xlabel("m", fontsize=8.0)
        axes.tick_params(labelsize=7.5)
    power = _gradient_power()
    _power_plane(panels[4], power)
    _power_share(panels[5], power)
    return figure


def _ridged(octaves: OctaveTable, x: LatticeArray, y: LatticeArray) -> Float64Array:
    """Return a ridged multifractal (Ebert et al. 2003, ch. 16)."""
    total, weight = np.zeros(x.shape), np.ones(x.shape)
    for i, (amplitude, _) in enumerate(octaves.scale):
        one = (part[i : i + 1] for part in (octaves.form, octaves.offset, octaves.scale))
        size = np.abs(fbm(OctaveTable(*one, {"one": (0, 1)}), "one", x, y)) / amplitude
        edge = 1 - np.where(size < _RIDGE_EDGE, 0.5 * (size * size / _RIDGE_EDGE + _RIDGE_EDGE), size)
        ridge = np.maximum(edge, 0) ** 2
        total += amplitude * ridge * weight
        weight = np.minimum(_RIDGE_WEIGHT * ridge, 1)
    return total


def _table(name: str, *, most: int = 7) -> Any:
    return octave_table([NoiseStack(name, _LONGEST, _GAIN, most=most)], extent=_EXTENT, seed=_SEED)


def _gradient_power() -> Float64Array:
    """Power of the gradients' eastward part over wave vectors, 1 on average."""
    cells = np.arange(_CELLS, dtype=np.int64)
    u, v = np.meshgrid(cells, cells)
    part = gradients(u, v, seed=_SEED)[0]
    part = part - part.mean()
    return np.fft.fftshift(np.abs(np.fft.fft2(part)) ** 2 / part.size / part.var())


def _power_plane(axes: Any, power: Float64Array) -> None:
    block = power.reshape(128, _CELLS // 128, 128, _CELLS // 128).mean(axis=(1, 3))
    axes.imshow(block, cmap="gray", vmin=0, vmax=3, extent=(-0.5, 0.5, -0.5, 0.5))
    axes.set_title("power of the gradients over waves, 0 to 3", loc="left", fontsize=10.0)
    axes.set_xlabel("waves a cell", fontsize=8.0)
    axes.tick_params(labelsize=7.5)


def _power_share(axes: Any, power: Float64Array) -> None:
    """Draw the share of modes above a power: e^-p for numbers that know nothing of each other."""
    found = np.sort(power.ravel())[::-1]
    axes.semilogy(
        found, (np.arange(found.size) + 1) / found.size, color=_BLUE, label="gradients from the hash"
    )
    even = np.linspace(0, found[0], 2)
    axes.semilogy(even, np.exp(-even), "--", color="#777777", label="chance, e⁻ᵖ")
    axes.set_title("share of modes above a power p", loc="left", fontsize=10.0)
    axes.set_xlabel("p", fontsize=8.0)
    axes.legend(fontsize=8.0, frameon=False)
    axes.tick_params(labelsize=7.5)


def main(arguments: list[str]) -> int:
    """Write the picture into the file that is named."""
    stream = io.BytesIO()
    draw_noise().savefig(stream, format="png", dpi=85)
    write_atomic(Path(arguments[0]), stream.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
