"""Detail below the resolution of real elevation: packed for kernels, and on the host in float64."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.detail_law import DetailLaw, slope_terms
from sketchterrain.io.resources import kernel_constants
from sketchterrain.terrain.layers.erosion import gully_octave, gully_steepness
from sketchterrain.terrain.layers.layer import HostSite, Sampling, WorldSettings, smooth_rise
from sketchterrain.terrain.noise import NoiseStack, OctaveTable, ValueSlope, octave_noise, omitted_amplitudes

_HEADER: Final = "layers/base_detail.clh"
_GULLY, _PER_NOISE, _PER_GULLY = kernel_constants(
    _HEADER, "BASE_GULLY", "INVERSE_NOISE_RMS", "INVERSE_GULLY_RMS"
)
_GAIN = 0.5
_PEAK = 5.0  # bound of an octave over its rms on the same slope
_DEVIATIONS = 4.0  # of the detail that its bound is, at least
_SQUEEZED = 1.05  # by how much that lowers the deviation


class DetailScale(NamedTuple):
    """What patches of a grid carry; means by their weights at points."""

    resolution: Float64Array | float  # longest wavelength that was lost, m
    depth: Float64Array | float  # factor of all amplitudes
    bound: Float64Array | float  # that no height moves farther than, m


@dataclass(frozen=True)
class BaseDetail:
    """Detail below grids of real elevation (docs/kernels/base.md)."""

    law: DetailLaw  # of the grid that covers most
    strength: float = 1.0  # 0 … 1

    def stack(self, world: WorldSettings) -> NoiseStack:
        """Return its noise."""
        return NoiseStack("base", world.extent / 8, _GAIN)

    def scale(self, law: DetailLaw, accuracy: float | None, world: WorldSettings) -> DetailScale:
        """Return what patches of a grid carry: with it, their detail has the rms that the grid lost.

        Heights move by less than its declared accuracy (m), or by less than 4 rms.
        """
        bound = _DEVIATIONS * law.lost if accuracy is None else accuracy
        finest = world.unit * 2.0 ** round(np.log2(self.stack(world).wavelength / world.unit))
        wavelength = finest * 2.0 ** (np.ceil(np.log2(law.resolution / finest)) - np.arange(16.0))
        octaves = _onset(wavelength / law.resolution) * self.law.octave(wavelength)
        rms = float(np.sqrt(np.sum(octaves**2)))
        depth = _SQUEEZED * min(law.lost, bound / _DEVIATIONS)
        return DetailScale(law.resolution, depth / rms if rms else 0.0, bound)

    def pack(self, sampling: Sampling) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays of the kernels' arguments."""
        names = ("gentle", "middling", "steep", "slope_square")
        values = sampling.ranges("base") | dict(zip(names, (*self.law.shape, self.law.slope**2), strict=True))
        octaves = np.stack(self._octaves(sampling.octaves, sampling.unit), axis=-1)
        return {
            "base_detail_params": sampling.struct(_HEADER, "BaseDetailParams", values),
            "base_detail_octave": octaves.astype(sampling.real),
        }

    def _octaves(self, octaves: OctaveTable, unit: float) -> tuple[Float64Array, Float64Array]:
        """Return the factors of the stack's octaves (m), and their wavelengths (m)."""
        wavelength = unit / octaves.scale[slice(*octaves.ranges["base"]), 1]
        nominal = (1 - _GAIN) * _GAIN ** np.arange(float(len(wavelength)))
        return self.strength * self.law.octave(wavelength) / nominal, wavelength

    def heights(self, site: HostSite, z: ValueSlope, data: DetailScale) -> Float64Array:
        """Return the detail (m) at points where the data have the heights and slopes z."""
        octaves = site.sampling.octaves
        square = z.east**2 + z.north**2
        depth = data.depth * np.sqrt(slope_terms(square, self.law.slope) @ self.law.shape)
        share = _GULLY * gully_steepness(square)
        rough, deep = depth * _PER_NOISE * np.sqrt(1 - share**2), depth * (_GULLY * _PER_GULLY)
        detail, cut = np.zeros(site.x.shape), ValueSlope(*np.zeros((3, *site.x.shape)))
        packed = zip(*self._octaves(octaves, site.sampling.unit), strict=True)
        for i, (factor, wavelength) in enumerate(packed, start=octaves.ranges["base"][0]):
            amplitude = _onset(wavelength / data.resolution) * factor * octaves.scale[i, 0]
            if np.any(amplitude):
                detail += rough * amplitude * octave_noise(octaves, i, site.x, site.y)
                cut = gully_octave(octaves, i, site, deep * amplitude, z, cut)
        detail += cut.value
        return np.asarray(detail * data.bound / np.maximum(np.hypot(detail, data.bound), 1e-300))

    def omitted(
        self, sampling: Sampling, data: DetailScale, turned: npt.NDArray[np.bool_]
    ) -> tuple[Float64Array, Float64Array]:
        """Return bounds (m) of what a cell size omits near n blocks, and of the detail.

        `data` (n,) are the largest values near each block. Where the slope of the data depends on the cell
        size, blocks are `turned`: all octaves differ.
        """
        factor, wavelength = self._octaves(sampling.all_octaves, sampling.unit)
        whole, left = omitted_amplitudes(sampling.all_octaves, sampling.octaves, "base")
        weight = _onset(wavelength / np.asarray(data.resolution)[:, None]) * factor
        peak = _PEAK * np.asarray(data.depth) * np.sqrt(max(self.law.shape))
        most = np.minimum(peak * (weight @ whole), data.bound)
        return np.minimum(peak * (weight @ (whole - left) + 2 * turned * (weight @ left)), 2 * most), most


def no_detail(sampling: Sampling) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of the kernels' arguments without any detail."""
    values = dict.fromkeys(("gentle", "middling", "steep", "slope_square", "base_first", "base_last"), 0)
    params = sampling.struct(_HEADER, "BaseDetailParams", values)
    return {"base_detail_params": params, "base_detail_octave": np.zeros((0, 2), sampling.real)}


def _onset(wavelengths: Any) -> Float64Array:
    """Return the weight of octaves by their wavelength over the resolution: 0 from 1 on, 1 up to 1/2."""
    return 1 - smooth_rise(wavelengths, 0.5, 0.5)
