"""The sun and the light of the sky."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.render.programs import fill_screen, set_uniforms

if TYPE_CHECKING:
    import moderngl

__all__ = ["LOWEST_SUN", "Sky", "Sun", "irradiance_harmonics"]

LOWEST_SUN: Final = -4.0
"""Degrees: below, in civil twilight, it gets too dark for a picture by the sky alone."""

SIZE: Final = 128
"""Texels a side of the sky's radiance by direction (kernels/render/sky_view.frag.glsl)."""
SUN_IRRADIANCE: Final = (20.0, 19.2, 18.4)
"""Above the atmosphere, in the units of all light here; the exposure divides them out again."""
GROUND_ALBEDO: Final = np.array([0.13, 0.12, 0.085])
"""What the ground far around gives back, on average, of the light that falls on it."""

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sun:
    """Where the sun stands.

    Attributes
    ----------
    azimuth : float
        Compass bearing, degrees clockwise from north.
    elevation : float
        Degrees above the horizon, in [-4, 90].
    """

    azimuth: float
    elevation: float = 30.0

    def __post_init__(self) -> None:
        if not LOWEST_SUN <= self.elevation <= 90.0:
            raise InputError(
                f"expected the sun's elevation in [{LOWEST_SUN:g}, 90] degrees, got {self.elevation:g}"
            )

    @property
    def direction(self) -> Floats:
        """Unit vector towards the sun, x east, y north, z up."""
        azimuth, elevation = np.radians([self.azimuth, self.elevation])
        return np.array(
            [
                np.sin(azimuth) * np.cos(elevation),
                np.cos(azimuth) * np.cos(elevation),
                np.sin(elevation),
            ]
        )


class Sky:
    """Radiance of the clear sky by direction, and the light that it and the sun throw on the ground.

    Attributes
    ----------
    view : moderngl.Texture
        128×128 RGBA16F, sky_view.frag.glsl says by what angles.
    sunlight : (3,) float64
        Irradiance of the sun on a surface that faces it, at the ground.
    harmonics : (9, 3) float64
        Irradiance from the whole sky and ground around, see `irradiance_harmonics`.
    exposure : float
        Brings sunlit ground of middle albedo to middle grey.
    """

    def __init__(
        self, context: moderngl.Context, sun: Sun, *, altitude: float = 0.0, dust: float = 1.0
    ) -> None:
        self.sun = sun
        self.view = context.texture((SIZE, SIZE), 4, dtype="f2")
        self.view.repeat_x = self.view.repeat_y = False
        target = context.framebuffer([self.view])
        paint = fill_screen(context, "sky_view.frag.glsl")
        set_uniforms(
            paint.program,
            {
                "sun_irradiance": SUN_IRRADIANCE,
                "sun_height": float(sun.direction[2]),
                "altitude": altitude,
                "dust": dust,
            },
        )
        target.use()
        paint.render(vertices=3)
        raw = np.frombuffer(self.view.read(), np.float16).reshape(SIZE, SIZE, 4)
        radiance = raw[..., :3].astype(np.float64)
        self.sunlight = _sunlight(sun, altitude, dust)
        self.harmonics = irradiance_harmonics(radiance, sun, self.sunlight)
        up = float(np.mean(sky_irradiance(self.harmonics, np.array([0.0, 0.0, 1.0]))))
        self.exposure = 6.2 / (float(np.mean(self.sunlight)) * (0.35 + 0.65 * sun.direction[2]) + up)


def irradiance_harmonics(radiance: Floats, sun: Sun, sunlight: Floats) -> Floats:
    """Project sky and lit ground onto the nine spherical harmonics that a matt surface can tell apart.

    Parameters
    ----------
    radiance
        (n, n, 3) sky radiance; rows √(elevation / 90°), columns angle from the sun's azimuth / 180°.
    sun
        Its azimuth turns the sky.
    sunlight
        (3,) irradiance of the sun on a surface that faces it.

    Returns
    -------
    (9, 3) float64
        Coefficients c such that the irradiance on normal (x, y, z) is c₀ + c₁y + c₂z + c₃x + c₄xy + c₅yz
        + c₆(3z²−1) + c₇xz + c₈(x²−y²): Ramamoorthi & Hanrahan 2001 with all constants folded in.
    """
    size = len(radiance)
    rise = np.linspace(0.0, 1.0, size)
    elevation = rise**2 * np.pi / 2
    turn = np.linspace(0.0, np.pi, size)
    share = np.gradient(elevation) * np.cos(elevation) * np.gradient(turn)[0]
    solid_angle = np.broadcast_to(share[:, None], (size, size)).copy()
    solid_angle[:, [0, -1]] *= 0.5
    solid_angle *= np.pi / solid_angle.sum()  # half the upper hemisphere
    lit = np.einsum("rc,rck->k", solid_angle * np.sin(elevation)[:, None], radiance) * 2.0
    below = GROUND_ALBEDO / np.pi * (lit + sunlight * sun.direction[2])
    azimuth = np.radians(90.0 - sun.azimuth)  # counter-clockwise from east
    total = np.zeros((9, 3))
    for side in (1.0, -1.0):
        x = np.cos(elevation)[:, None] * np.cos(azimuth + side * turn)
        y = np.cos(elevation)[:, None] * np.sin(azimuth + side * turn)
        z = np.broadcast_to(np.sin(elevation)[:, None], x.shape)
        total += np.einsum("brc,rck->bk", _basis(x, y, z) * solid_angle, radiance)
        total += np.einsum("brc,rc,k->bk", _basis(x, y, -z), solid_angle, below)
    return np.asarray(total * _LOBE[:, None])


def sky_irradiance(harmonics: Floats, normal: Floats) -> Floats:
    """Evaluate `irradiance_harmonics` for one unit normal, the oracle of ``sky_irradiance`` in frame.glsl."""
    x, y, z = normal
    terms = np.array([1.0, y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y])
    return np.asarray(terms @ harmonics)


def _basis(x: Floats, y: Floats, z: Floats) -> Floats:
    one = np.ones_like(x)
    return np.stack([one, y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y])


_NORM: Final = np.array(
    [0.282095, 0.488603, 0.488603, 0.488603, 1.092548, 1.092548, 0.315392, 1.092548, 0.546274]
)
_LOBE: Final = _NORM**2 * np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)


def _sunlight(sun: Sun, altitude: float, dust: float) -> Floats:
    """Attenuate sunlight through the air of sky_view.frag.glsl (plane-parallel, Kasten's air mass)."""
    elevation = sun.elevation
    mass = 1.0 / (np.sin(np.radians(elevation)) + 0.50572 * (elevation + 6.07995) ** -1.6364)
    rayleigh = np.array([5.802e-6, 13.558e-6, 33.1e-6]) * 8000.0 * np.exp(-altitude / 8000.0)
    mie = 4.436e-6 * dust * 1200.0 * np.exp(-altitude / 1200.0)
    ozone = np.array([0.65e-6, 1.881e-6, 0.085e-6]) * 15_000.0
    return np.asarray(np.array(SUN_IRRADIANCE) * np.exp(-mass * (rayleigh + mie + ozone)))
