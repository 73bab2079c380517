"""Detail below real DEMs that were cut to a quarter and an eighth, beside what the cut lost."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.report import Row, Table
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.detail_law import DetailLaw, measure_detail
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.mips import without_voids
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.measure.realism_metrics import spectral_slopes
from sketchterrain.terrain.layers.base_detail import BaseDetail
from sketchterrain.terrain.layers.layer import HostSite, Sampling, WorldSettings
from sketchterrain.terrain.noise import FINEST_CELL, ValueSlope, octave_noise, octave_table

VARIABLE = "SKETCHTERRAIN_DEMS"
"""Folder of the DEMs beside matplotlib's, if there is one."""

SEED = 5
CUTS = (4, 8)
CLASSES = 4
_DEMS = {
    "bigtujunga30m_utm11.tif": ("Big Tujunga", "EPSG:32611"),
    "N42E001.hgt.zip": ("Andorra", "EPSG:32631"),
    "terra_elev_vinschgau.tif": ("Vinschgau", "EPSG:32632"),
}
_LEAST = 40  # samples of a cut grid along a side
_SIDE = 720  # most samples of a truth along a side
_RIM = 3  # samples of the cut grid at its rim that are not compared
_SHORTEST = 3.0  # truth's samples a wavelength: shorter waves are its own filter and noise

_HEADINGS = {
    "cut": "cut to, m",
    "lost": "lost, rms m",
    "ratio": "added / lost",
    "beta": "β − β of the truth",
    "spread": "± by lattice",
    "truth": "β of the truth",
    "bare": "β − … without",
    "moved": "farthest sample / ε",
}


@dataclass(frozen=True)
class _CutGround:
    """A DEM, and the spline through its means of n × n samples with their detail's law."""

    truth: Float64Array
    smooth: ValueSlope
    at: tuple[Float64Array, Float64Array]
    law: DetailLaw
    n: int
    known: Any

    @classmethod
    def from_grid(cls, grid: ElevationGrid, n: int) -> _CutGround:
        rows, columns = (min(side, _SIDE) // n * n for side in grid.samples.shape)
        z = grid.samples[:rows, :columns]
        known = np.isfinite(z)
        means = without_voids(z).astype(np.float64).reshape(rows // n, n, columns // n, n).mean(axis=(1, 3))
        a, b, c, d, e, f = grid.place
        half = 0.5 * (n - 1)
        place = (n * a, n * b, c + half * (a + b), n * d, n * e, f + half * (d + e))
        cut = replace(grid, samples=means.astype(np.float32), place=place)
        patches = build_patches(cut)
        work = Patchwork({patches.id: patches})
        x, y = grid.to_metres(*np.meshgrid(np.arange(float(columns)), np.arange(float(rows))))
        found = work.surface(work.cover(0.0)).evaluate(x, y)
        inner = np.zeros(z.shape, bool)
        inner[_RIM * n : -_RIM * n, _RIM * n : -_RIM * n] = True
        smooth = ValueSlope(found.height, found.east, found.north)
        truth = without_voids(z).astype(np.float64)
        return cls(truth, smooth, (x, y), measure_detail(cut), n, known & inner)

    @property
    def lost(self) -> Float64Array:
        return self.truth - self.smooth.value

    def added(self, phase: float, fixed: float | None = None) -> Float64Array:
        """Return the detail; or fBm of a fixed rms over the resolution, the same on all slopes."""
        step = self.law.step / self.n
        world = WorldSettings(4096.0 * step * 2.0**phase, SEED, 1.0)
        detail = BaseDetail(self.law)
        octaves, full = (
            octave_table([detail.stack(world)], extent=world.extent, seed=SEED, cell_size=cell)
            for cell in (step, FINEST_CELL)
        )
        x, y = (to_lattice(each.ravel() - each.min(), world.extent) for each in self.at)
        if fixed is None:
            z = ValueSlope(*(each.ravel() for each in self.smooth))
            sampling = Sampling(world, step, octaves, full, np.dtype(np.float64))
            found = detail.heights(HostSite(sampling, x, y), z, detail.scale(self.law, None, world))
        else:
            found = np.zeros(x.shape)
            for i in range(*octaves.ranges["base"]):
                if world.unit / octaves.scale[i, 1] < self.law.resolution:
                    found += octaves.scale[i, 0] * octave_noise(octaves, i, x, y)
            found *= fixed * self.law.resolution / found.std()
        return found.reshape(self.truth.shape)

    def rows(self, name: str, fixed: float, lattices: int) -> Iterator[Row]:
        """Return the rows of both methods."""
        lost, slope = self.lost, np.hypot(self.smooth.east, self.smooth.north)
        ends = np.quantile(slope[self.known], np.linspace(0.0, 1.0, CLASSES + 1))
        classes = [self.known & (slope >= low) & (slope <= high) for low, high in pairwise(ends)]
        inner = (slice(_RIM * self.n, -_RIM * self.n),) * 2
        truth, bare = (self._beta(each[inner]) for each in (self.truth, self.smooth.value))
        for method in ("this", "fBm"):
            rms = None if method == "this" else fixed
            found = [self.added(k / lattices, rms) for k in range(lattices)]
            ratio = [
                [_rms(each[part]) / _rms(lost[part]) for part in (self.known, *classes)] for each in found
            ]
            beta = np.array([self._beta((self.smooth.value + each)[inner]) for each in found]) - truth
            whole, *by_class = np.mean(ratio, axis=0)
            yield {
                "dem": name,
                "cut": round(self.law.step),
                "method": method,
                "lost": _rms(lost[self.known]),
                "ratio": float(whole),
                **{f"class_{i}": float(each) for i, each in enumerate(by_class)},
                "beta": float(beta.mean()),
                "spread": float(np.abs(beta - beta.mean()).max()),
                "truth": truth,
                "bare": bare - truth,
                "moved": max(float(np.abs(each).max()) for each in found) / (4.0 * self.law.lost),
            }

    def _beta(self, z: Float64Array) -> float:
        """Return the exponent of the spectrum from four samples of the cut to three of the truth."""
        return spectral_slopes(z, (4.0 * self.n, _SHORTEST), bins=9)[0]


def table(lattices: int) -> Table:
    """Return what is added to each DEM, with wavelengths of octaves shifted by parts of an octave."""
    grounds = [
        (name, _CutGround.from_grid(grid, n))
        for name, grid in _dems()
        for n in CUTS
        if min(grid.samples.shape) >= _LEAST * n
    ]
    # fBm gets the amplitude that suits all of them best.
    fixed = [np.log(_rms(each.lost[each.known]) / each.law.resolution) for _, each in grounds]
    rows = [row for name, each in grounds for row in each.rows(name, float(np.exp(np.mean(fixed))), lattices)]
    return Table("Detail below the samples", tuple(rows), _HEADINGS)


def _dems() -> Iterator[tuple[str, ElevationGrid]]:
    folder = Path(os.environ.get(VARIABLE, ""))
    for file, (name, crs) in _DEMS.items():
        if (folder / file).is_file():
            yield name, read_grid(folder / file, SketchFrame(crs))
    if find_spec("matplotlib") is not None:
        from matplotlib import get_data_path

        path = Path(get_data_path()) / "sample_data" / "jacksboro_fault_dem.npz"
        yield "Jacksboro", read_grid(path, SketchFrame("EPSG:32616"), crs="EPSG:4326")


def _rms(values: Float64Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
