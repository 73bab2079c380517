"""Irradiance of sky and surrounding ground as nine spherical harmonics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.render.atmosphere import GROUND_ALBEDO

if TYPE_CHECKING:
    from sketchterrain.render.sky import Sun


def irradiance_harmonics(radiance: Float64Array, sun: Sun, sunlight: Float64Array) -> Float64Array:
    """Project sky radiance (n, n, 3) and the lit ground onto (9, 3) irradiance coefficients.

    Rows of the radiance are √(elevation / 90°), columns √(angle from the sun's azimuth / 180°). Irradiance on
    a normal (x, y, z) is c₀ + c₁y + c₂z + c₃x + c₄xy + c₅yz + c₆(3z²−1) + c₇xz + c₈(x²−y²): Ramamoorthi &
    Hanrahan 2001 with all constants folded in.
    """
    size = len(radiance)
    rise = np.linspace(0.0, 1.0, size)
    elevation = rise**2 * np.pi / 2
    turn = rise * np.pi
    radiance = _interpolated(radiance, np.sqrt(rise) * (size - 1))
    solid_angle = (_widths(elevation) * np.cos(elevation))[:, None] * _widths(turn)
    solid_angle *= np.pi / solid_angle.sum()  # half the upper hemisphere
    lit = np.einsum("rc,rck->k", solid_angle * np.sin(elevation)[:, None], radiance) * 2.0
    below = GROUND_ALBEDO / np.pi * (lit + sunlight * max(sun.direction[2], 0.0))
    azimuth = np.radians(90.0 - sun.azimuth)  # counter-clockwise from east
    total = np.zeros((9, 3))
    for side in (1.0, -1.0):
        x = np.cos(elevation)[:, None] * np.cos(azimuth + side * turn)
        y = np.cos(elevation)[:, None] * np.sin(azimuth + side * turn)
        z = np.broadcast_to(np.sin(elevation)[:, None], x.shape)
        total += np.einsum("brc,rck->bk", _basis(x, y, z) * solid_angle, radiance)
        total += np.einsum("brc,rc,k->bk", _basis(x, y, -z), solid_angle, below)
    return np.asarray(total * _LOBE[:, None])


def sky_irradiance(harmonics: Float64Array, normal: Float64Array) -> Float64Array:
    """Evaluate `irradiance_harmonics` for one unit normal; the oracle of ``sky_irradiance`` in frame.glsl."""
    x, y, z = normal
    terms = np.array([1.0, y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y])
    return np.asarray(terms @ harmonics)


def _interpolated(table: Float64Array, columns: Float64Array) -> Float64Array:
    """Interpolate between a table's columns."""
    left = np.minimum(columns.astype(np.intp), table.shape[1] - 2)
    share = (columns - left)[:, None]
    return np.asarray(table[:, left] + share * (table[:, left + 1] - table[:, left]))


def _widths(places: Float64Array) -> Float64Array:
    """Return the trapezoid-rule weights of ascending abscissae."""
    gaps = np.diff(places)
    return np.asarray(0.5 * (np.append(gaps, 0.0) + np.append(0.0, gaps)))


def _basis(x: Float64Array, y: Float64Array, z: Float64Array) -> Float64Array:
    one = np.ones_like(x)
    return np.stack([one, y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y])


_NORM: Final = np.array(
    [0.282095, 0.488603, 0.488603, 0.488603, 1.092548, 1.092548, 0.315392, 1.092548, 0.546274]
)
_LOBE: Final = _NORM**2 * np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)
