"""Atmospheric scattering as precomputed tables after Hillaire 2020.

S. Hillaire, A Scalable and Production Ready Sky and Atmosphere Rendering Technique, EGSR 2020; the parameters
of the transmittance table and the sun's visibility at the horizon are Bruneton's (2017). All is NumPy in
double precision: the tables are small, and take less time than a driver needs to build programs for them.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array

GROUND: Final = 6360e3  # radius of the ground (m)
TOP: Final = 6460e3  # radius of the top of the atmosphere (m)
RAYLEIGH: Final = np.array([5.802e-6, 13.558e-6, 33.1e-6])
"""Scattering by molecules at sea level (1/m), for red, green and blue (680, 550, 440 nm)."""
RAYLEIGH_HEIGHT: Final = 8000.0
AEROSOL: Final = 6.8e-5 * (np.array([680.0, 550.0, 440.0]) / 550.0) ** -1.0
"""Scattering by aerosols of a clear day (1/m): vertical optical depth 0.08, Ångström exponent 1."""
AEROSOL_ABSORBED: Final = 0.1  # absorption by aerosols over their scattering
AEROSOL_HEIGHT: Final = 1200.0
FORWARD: Final = 0.76  # asymmetry parameter g of aerosols (mean cosine of the scattering angle)
OZONE: Final = np.array([1.5e-6, 1.881e-6, 0.085e-6])
"""Peak absorption, 25 km up (1/m); none is 15 km above or below.

Red as its mean over 600 to 680 nm: at 680 nm alone there is so little that twilight turns purple.
"""
GROUND_ALBEDO: Final = np.array([0.13, 0.12, 0.085])  # mean albedo of the ground far around
SUN_RADIUS: Final = np.radians(0.267)  # angular radius of the sun's disc (rad)

_HEIGHTS, _ANGLES = 48, 128  # of the transmittance table
_STEPS = 40
_PSI_HEIGHTS, _PSI_ANGLES = 12, 24
_LOWEST_ROOT: Final = 0.3
"""`_signed_root` of the sun's lowest cosine in the table of Ψ: 9° under the horizon."""
_PSI_DIRECTIONS, _PSI_STEPS = 32, 16


class PathLight(NamedTuple):
    """In-scattered radiance and transmittance of a path, (..., 3) each, for a sun of irradiance 1."""

    radiance: Float64Array
    clear: Float64Array


@dataclass(frozen=True, eq=False)
class Air:
    """Atmosphere over level ground; `haze` scales its aerosols, 1 is a clear day."""

    haze: float = 1.0

    def scattering(self, height: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return scattering by molecules, by aerosols, and extinction, (..., 3) 1/m, at heights (m)."""
        height = np.maximum(height, 0.0)
        rayleigh = np.exp(height / -RAYLEIGH_HEIGHT)[..., None] * RAYLEIGH
        aerosol = np.exp(height / -AEROSOL_HEIGHT)[..., None] * (AEROSOL * self.haze)
        ozone = np.maximum(0.0, 1.0 - np.abs(height - 25e3) / 15e3)[..., None] * OZONE
        return rayleigh, aerosol, rayleigh + aerosol * (1.0 + AEROSOL_ABSORBED) + ozone

    def sunlight(self, height: Float64Array, cosine: Float64Array) -> Float64Array:
        """Return transmitted sunlight, (..., 3), at heights (m), by cosine of the sun's zenith angle.

        Only the part of the disc above the horizon of bare ground counts.
        """
        r = np.maximum(height, 0.0) + GROUND
        dip = -np.sqrt(np.maximum(1.0 - (GROUND / r) ** 2, 0.0))
        risen = np.clip((cosine - dip) / (2.0 * np.sin(SUN_RADIUS)) + 0.5, 0.0, 1.0)
        part = risen * risen * (3.0 - 2.0 * risen)
        return np.asarray(self.transmittance(r, np.maximum(cosine, dip)) * part[..., None])

    def transmittance(self, r: Float64Array, cosine: Float64Array) -> Float64Array:
        """Return transmittance, (..., 3), from radii (m) to space on lines that miss the ground."""
        full = np.sqrt(TOP**2 - GROUND**2)
        rho = np.sqrt(np.maximum(r * r - GROUND**2, 0.0))
        shortest, longest = TOP - r, rho + full
        way = np.maximum(
            -r * cosine + np.sqrt(np.maximum(r * r * (cosine * cosine - 1.0) + TOP**2, 0.0)), 0.0
        )
        angle = (way - shortest) / (longest - shortest)
        return np.asarray(np.exp(-_bilinear(self._depths, rho / full, angle)))

    @cached_property
    def _depths(self) -> Float64Array:
        """Optical depth to the top, by √(r² − ground²) and the distance to the top (Bruneton 2017)."""
        full = np.sqrt(TOP**2 - GROUND**2)
        rho = np.linspace(0.0, full, _HEIGHTS)[:, None]
        r = np.sqrt(rho**2 + GROUND**2)
        way = (TOP - r) + np.linspace(0.0, 1.0, _ANGLES) * (rho + full - (TOP - r))
        cosine = (full**2 - rho**2 - way**2) / (2.0 * r * np.maximum(way, 1.0))
        cosine = np.clip(cosine, -1.0, 1.0)
        nodes, weights = np.polynomial.legendre.leggauss(_STEPS)
        # A line that grazes the ground is densest at its perigee, which lies −r cosine along it.
        total = np.zeros((*way.shape, 3))
        perigee = np.clip(-r * cosine, 0.0, way)
        for start, stop in ((perigee, way), (perigee, np.zeros_like(way))):
            for node, weight in zip(0.5 + 0.5 * nodes, weights, strict=True):
                along = start + (stop - start) * node**2
                height = np.sqrt(r * r + along * along + 2.0 * r * along * cosine) - GROUND
                share = weight * node * np.abs(stop - start)
                total += share[..., None] * self.scattering(height)[2]
        return total

    def multiple_scattering(self, height: Float64Array, cosine: Float64Array) -> Float64Array:
        """Return the isotropic radiance, (..., 3), of multiple scattering: Ψ of Hillaire's equation 10."""
        at_height = np.sqrt(np.clip(height / (TOP - GROUND), 0.0, 1.0))
        at_angle = (_signed_root(cosine) - _LOWEST_ROOT) / (1.0 - _LOWEST_ROOT)
        return np.asarray(np.exp(_bilinear(self._psi, at_height, at_angle)))

    @cached_property
    def _psi(self) -> Float64Array:
        """Logarithm of Ψ, which falls by powers of ten once the sun has set."""
        height = np.linspace(0.0, 1.0, _PSI_HEIGHTS) ** 2 * (TOP - GROUND)
        along = 2.0 * np.linspace(_LOWEST_ROOT, 1.0, _PSI_ANGLES) - 1.0
        cosine = along * np.abs(along)
        number = np.arange(_PSI_DIRECTIONS) + 0.5
        z, turn = 1.0 - 2.0 * number / _PSI_DIRECTIONS, number * np.pi * (3.0 - np.sqrt(5.0))
        flat = np.sqrt(1.0 - z * z)
        directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=-1)
        psi = self.multiple_scattering_source(height[:, None], cosine[None, :], directions, steps=_PSI_STEPS)
        return np.asarray(np.log(np.maximum(psi, 1e-12)))

    def multiple_scattering_source(
        self, height: Float64Array, cosine: Float64Array, directions: Float64Array, *, steps: int
    ) -> Float64Array:
        """Compute Ψ from (n, 3) directions spread evenly over the sphere: Hillaire's equations 5 to 10."""
        height, cosine = np.broadcast_arrays(height, cosine)
        sun = np.stack([np.sqrt(np.maximum(1.0 - cosine**2, 0.0)), np.zeros_like(cosine), cosine], axis=-1)
        r = np.maximum(height, 1.0)[..., None] + GROUND
        length, hits = _boundary_distance(r, directions[:, 2])
        sun_along = sun[..., None, :]
        path = self.integrate(
            r - GROUND, directions, sun_along, length, steps=steps, multiple=False, phases=False
        )
        foot = np.sqrt(r * r + length**2 + 2.0 * r * length * directions[:, 2])
        below = (r * cosine[..., None] + length * (directions * sun_along).sum(axis=-1)) / foot
        lit = self.sunlight(np.zeros_like(below), below) * np.maximum(below, 0.0)[..., None]
        bounced = path.clear * lit * (GROUND_ALBEDO / np.pi) * hits[..., None]
        second = (path.radiance + bounced).mean(axis=-2)
        unit = self.integrate(
            r - GROUND, directions, sun_along, length, steps=steps, multiple=False, phases=False, lit=False
        )
        return np.asarray(second / (1.0 - unit.radiance.mean(axis=-2) * (4.0 * np.pi)))

    def integrate(
        self,
        height: Float64Array,
        directions: Float64Array,
        sun: Float64Array,
        length: Float64Array,
        *,
        steps: int,
        multiple: bool = True,
        phases: bool = True,
        lit: bool = True,
    ) -> PathLight:
        """Integrate scattering along lines of sight of some length (m), in ever longer steps.

        `multiple` adds multiply scattered light; without `phases` scattering is isotropic; without `lit` the
        air is lit by 1 everywhere instead of by the sun.
        """
        r = height + GROUND
        up, sunward = directions[..., 2], (directions * sun).sum(axis=-1)
        by_rayleigh = 3.0 / (16.0 * np.pi) * (1.0 + sunward * sunward)[..., None] if phases else 0.25 / np.pi
        by_aerosol = aerosol_phase(sunward)[..., None] if phases else 0.25 / np.pi
        edges = np.linspace(0.0, 1.0, steps + 1) ** 2
        radiance: Float64Array | float = 0.0
        clear: Float64Array | float = 1.0
        for start, stop in pairwise(edges):
            along = 0.5 * (start + stop) * length
            radius = np.sqrt(r * r + along * along + 2.0 * r * along * up)
            rayleigh, aerosol, extinction = self.scattering(radius - GROUND)
            source = rayleigh * by_rayleigh + aerosol * by_aerosol
            if lit:
                cosine = (r * sun[..., 2] + along * sunward) / radius
                source = source * self.sunlight(radius - GROUND, cosine)
                if multiple:
                    source += (rayleigh + aerosol) * self.multiple_scattering(radius - GROUND, cosine)
            step = np.exp(-extinction * ((stop - start) * length)[..., None])
            radiance = radiance + clear * source * (1.0 - step) / extinction
            clear = clear * step
        return PathLight(np.asarray(radiance), np.asarray(clear))

    def sky(
        self,
        height: float,
        directions: Float64Array,
        sun: Float64Array,
        *,
        steps: int,
        longest: float = np.inf,
    ) -> PathLight:
        """Integrate along directions to the top of the air or the ground, or for `longest` m."""
        r = np.asarray(max(height, 1.0) + GROUND)
        length = np.asarray(np.minimum(_boundary_distance(r, directions[..., 2])[0], longest))
        return self.integrate(r - GROUND, directions, sun, length, steps=steps)


@lru_cache(maxsize=4)
def air_with_haze(haze: float) -> Air:
    """Return the air of a haze; its tables are the most expensive part of a sky."""
    return Air(haze)


def aerosol_phase(cosine: Float64Array) -> Float64Array:
    """Evaluate the phase function of aerosols, 1/sr (Cornette & Shanks 1992)."""
    g = FORWARD
    share = 3.0 / (8.0 * np.pi) * (1.0 - g * g) / (2.0 + g * g)
    return np.asarray(share * (1.0 + cosine * cosine) / (1.0 + g * g - 2.0 * g * cosine) ** 1.5)


def _boundary_distance(r: Float64Array, up: Float64Array) -> tuple[Float64Array, BoolArray]:
    """Return the distance to the top of the air or the ground (m), and whether it is the ground."""
    r, up = np.broadcast_arrays(r, up)
    room = r * r * (up * up - 1.0)
    hits = (up < 0.0) & (room + GROUND**2 >= 0.0)
    to_ground = -r * up - np.sqrt(np.maximum(room + GROUND**2, 0.0))
    to_top = -r * up + np.sqrt(np.maximum(room + TOP**2, 0.0))
    return np.where(hits, to_ground, to_top), hits


def _signed_root(cosine: Float64Array) -> Float64Array:
    """Map cosines −1 … 1 to 0 … 1, finest around 0."""
    return np.asarray(0.5 + 0.5 * np.copysign(np.sqrt(np.abs(cosine)), cosine))


def _bilinear(table: Float64Array, row: Float64Array, column: Float64Array) -> Float64Array:
    """Interpolate a (rows, columns, 3) table at shares 0 … 1 of its rows and columns."""
    rows, columns = table.shape[:2]
    y, x = np.broadcast_arrays(np.clip(row, 0.0, 1.0) * (rows - 1), np.clip(column, 0.0, 1.0) * (columns - 1))
    j = np.minimum(y.astype(np.intp), rows - 2)
    i = np.minimum(x.astype(np.intp), columns - 2)
    v, u = (y - j)[..., None], (x - i)[..., None]
    flat, at = table.reshape(-1, 3), j * columns + i
    low = flat[at] + u * (flat[at + 1] - flat[at])
    high = flat[at + columns] + u * (flat[at + columns + 1] - flat[at + columns])
    return np.asarray(low + v * (high - low))
