"""Weather, the sun's position, the sky's radiance, irradiance and exposure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import moderngl
import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera, direction
from sketchterrain.render.atmosphere import (
    AEROSOL,
    AEROSOL_ABSORBED,
    AEROSOL_HEIGHT,
    GROUND_ALBEDO,
    RAYLEIGH,
    Air,
    air_with_haze,
)
from sketchterrain.render.programs import clamped
from sketchterrain.render.scene import HeightMap, TerrainSource, sample_heights
from sketchterrain.schema.parameters import SKIES

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


@dataclass(frozen=True)
class Weather:
    """Sky and wind over a terrain."""

    hour: float | None = None  # local solar time, 0 … 24; None: the sun that suits the view best
    sky: str = SKIES[0]  # kind of clouds, one of `SKIES`
    clouds: float = 0.35  # cloud cover, 0 clear … 1 overcast
    wind: float = 4.0  # m/s
    wind_from: float = 245.0  # compass bearing that it blows from, degrees
    latitude: float = 45.0  # degrees north
    haze: float = 1.0  # aerosols: 0 none, 1 a clear day, 10 a murky one

    def __post_init__(self) -> None:
        if self.sky not in SKIES:
            raise InputError(f"expected a sky, one of {', '.join(SKIES)}, got {self.sky!r}")
        checks = (
            ("an hour", self.hour, 0.0, 24.0),
            ("a cloud cover", self.clouds, 0.0, 1.0),
            ("a wind, in m/s,", self.wind, 0.0, 40.0),
            ("a bearing of the wind, in degrees,", self.wind_from, 0.0, 360.0),
            ("a latitude, in degrees,", self.latitude, -90.0, 90.0),
            ("a haze", self.haze, 0.0, 10.0),
        )
        for what, value, low, high in checks:
            if value is not None and not low <= value <= high:
                raise InputError(f"expected {what} in [{low:g}, {high:g}], got {value:g}")

    @property
    def cover(self) -> float:
        """Share of the sky under clouds that cast shadows."""
        return {"stratus": 1.0, "cirrus": 0.0, "clear": 0.0}.get(self.sky, self.clouds)

    @property
    def overcast(self) -> float:
        """Weight of a closed grey layer over sky and sun."""
        return _smooth(self.cover, *OVERCAST[self.sky == "stratocumulus"])

    @property
    def drift(self) -> tuple[float, float]:
        """Wind vector, (east, north) m/s."""
        bearing = math.radians(self.wind_from)
        return -self.wind * math.sin(bearing), -self.wind * math.cos(bearing)

    @classmethod
    def from_sketch(cls, sketch: Sketch, **given: float | str | None) -> Weather:
        """Return a sketch's ``[weather]``, overridden by the fields given."""
        table: dict[str, Any] = dict(sketch.weather)
        at = table.pop("hour", -1.0)
        weather = cls(hour=at if at >= 0.0 else None, **table)
        changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        return replace(weather, **changes)


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
    columns = np.sqrt(rise) * (size - 1)
    left = np.minimum(columns.astype(np.intp), size - 2)
    radiance = radiance[:, left] + (columns - left)[:, None] * (radiance[:, left + 1] - radiance[:, left])
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
    return np.asarray(_basis(*normal) @ harmonics)


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


LOWEST_SUN: Final = -4.0
"""Degrees: below, in civil twilight, it gets too dark for a picture by the sky alone."""
SIZE: Final = 64
"""Texels along the azimuth, and of each half along the elevation: kernels/render/frame.glsl, sky_place."""
STEPS: Final = 24
AIR_STEPS: Final = 16
LEVELS: Final = (0.0, 600.0, 1800.0, 4000.0)
"""Heights over the haze's base (m) at which the sky is computed; it is interpolated in between."""
LONGEST: Final = 30e3  # longest path (m) that the air's light of a direction is integrated over …
RISE: Final = 1500.0  # … up to the height of mountains over the eye (m)
SUN_IRRADIANCE: Final = np.array([20.0, 22.6, 25.4])
"""Above the atmosphere, in the unit of all light here; channel ratios are of a daylight white balance."""
HAZE: Final = AEROSOL * (1.0 + AEROSOL_ABSORBED)
"""Extinction by aerosols on a clear day, at the haze's base (1/m)."""
SMALL_WORLD: Final = 0.25
"""Smallest optical depth of an extent: small worlds, which end near, end in haze too."""
LARGE_WORLD: Final = (21_000.0, 2.5)
"""Extent (m) beyond which air gets thinner by this power: a large sketch seen as a whole is no fog."""
SHADED_AIR: Final = 0.4
"""Share of in-scattered light removed in shadow: a little less than the single-scattered sunlight."""
RISING: Final = (0.0, 3.0)  # degrees of elevation over which shadows in the air fade in
OVERCAST: Final = ((0.6, 1.0), (0.8, 1.0))
"""Covers over which a uniform grey layer replaces sky and sun: by cumulus, by stratocumulus."""
OVERCAST_CLEAR: Final = np.array([0.33, 0.34, 0.35])
"""Transmittance of a closed cloud layer for the light on level ground."""


@dataclass(frozen=True)
class Sun:
    """Direction of the sun: compass bearing and elevation (-4 … 90), degrees."""

    azimuth: float
    elevation: float = 30.0

    def __post_init__(self) -> None:
        if not LOWEST_SUN <= self.elevation <= 90.0:
            raise InputError(
                f"expected the sun's elevation in [{LOWEST_SUN:g}, 90] degrees, got {self.elevation:g}"
            )

    @property
    def direction(self) -> Float64Array:
        """Unit vector towards the sun, x east, y north, z up."""
        return direction(self.azimuth, self.elevation)


MIDDLE: Final = 0.085  # albedo of ground that becomes middle grey, 0.18 of white, on a sunny noon
BRIGHT: Final = 17.0  # light of a sunny noon, as computed for the exposure
ADAPTED: Final = 0.88  # exponent by which exposure compensates darkness: a dawn stays a little dark
AGAINST_LIGHT: Final = 0.5  # the same for a view whose horizon is brighter than the average one
VIEW: Final = 30.0  # degrees to the left and the right that count for it


class SkyLight:
    """Light of sun and sky on the ground.

    `sunlight` (3,) is the sun's irradiance on a surface facing it, at the ground; `harmonics` (9, 3), see
    `irradiance_harmonics`; `shaded_air` the share of the air's light missing over shadow; `haze` (3,) aerosol
    extinction at its base (1/m), `rayleigh` (3,) that of molecules at sea level; `extinction` that of both on
    paths to mountains, green. On sketches beyond `LARGE_WORLD` all three are less than in real air, so that
    the optical depth across them does not grow; the light of sun and sky is that of real air.
    """

    def __init__(self, sun: Sun, weather: Weather, *, extent: float = np.inf) -> None:
        self.sun = sun
        self.air = air_with_haze(weather.haze)
        largest, power = LARGE_WORLD
        thin = min((largest / extent) ** power, 1.0) if np.isfinite(extent) else 1.0
        self.haze = weather.haze * np.maximum(thin * HAZE, SMALL_WORLD / extent)
        self.rayleigh = thin * RAYLEIGH
        self.extinction = float(self.rayleigh[1] + 0.5 * self.haze[1])
        self._levels: dict[int, Float64Array] = {}
        ground = sky_table(self.air, sun, LEVELS[0])
        shone = self.air.sunlight(np.zeros(()), np.array(sun.direction[2])) * SUN_IRRADIANCE
        clear = irradiance_harmonics(ground[SIZE:], sun, shone)
        self.overcast = weather.overcast
        level = np.array([0.0, 0.0, 1.0])
        total = shone * max(sun.direction[2], 0.0) + sky_irradiance(clear, level)
        self._overcast_sky = overcast_table(OVERCAST_CLEAR * float(total.mean()))
        self._levels[0] = ground = self._with_overcast(ground)
        self.sunlight = (1.0 - self.overcast) * shone
        self.shaded_air = SHADED_AIR * (1.0 - self.overcast) * _smooth(sun.elevation, *RISING)
        self.harmonics = irradiance_harmonics(ground[SIZE:], sun, self.sunlight)
        up = float(sky_irradiance(self.harmonics, level).mean())
        # Ground of albedo `MIDDLE` becomes middle grey, less so where there is less light.
        light = float(self.sunlight.mean()) * (0.3 + 0.7 * max(sun.direction[2], 0.0)) + up
        self._exposure = float(0.18 / MIDDLE * np.pi / BRIGHT * (BRIGHT / light) ** ADAPTED)

    def exposure(self, heading: float) -> float:
        """Return the exposure for a view's compass direction (degrees): lower against the light."""
        air = np.log(self._levels[0][SIZE // 2].mean(axis=-1))
        azimuth = np.pi * np.linspace(0.0, 1.0, SIZE) ** 2
        off = np.radians(heading - self.sun.azimuth + np.linspace(-VIEW, VIEW, 33))
        ahead = float(np.interp(np.abs(np.angle(np.exp(1j * off))), azimuth, air).mean())
        around = float(np.interp(np.linspace(0.0, np.pi, 91), azimuth, air).mean())
        return self._exposure * float(np.exp(AGAINST_LIGHT * (around - ahead)))

    def table(self, height: float) -> Float64Array:
        """Return the sky's radiance (128, 64, 3) at a height over the haze's base (m), as `sky_table`."""
        lower, share = level_weight(height)
        low, high = (self._level(number) for number in (lower, lower + 1))
        return low + share * (high - low)

    def _level(self, number: int) -> Float64Array:
        """Return the table for a height of `LEVELS`, computed on first use."""
        if number not in self._levels:
            self._levels[number] = self._with_overcast(sky_table(self.air, self.sun, LEVELS[number]))
        return self._levels[number]

    def _with_overcast(self, table: Float64Array) -> Float64Array:
        return np.asarray(table + self.overcast * (self._overcast_sky - table))


class Sky(SkyLight):
    """Light of sun and sky, and the sky's radiance by direction for shaders.

    `view` is a 64×128 RGBA16F texture, see clear_sky and air_light in kernels/render/frame.glsl.
    """

    def __init__(
        self, context: moderngl.Context, sun: Sun, weather: Weather, *, extent: float = np.inf
    ) -> None:
        super().__init__(sun, weather, extent=extent)
        self.view = clamped(context.texture((SIZE, 2 * SIZE), 4, dtype="f2"))
        self._height = -np.inf
        self.set_height(0.0)

    def set_height(self, height: float) -> None:
        """Update `view` for a height over the haze's base (m)."""
        height = float(np.clip(height, LEVELS[0], LEVELS[-1]))
        if abs(height - self._height) <= 0.01 * max(height, 100.0):
            return
        self._height = height
        table = np.ones((2 * SIZE, SIZE, 4), np.float16)
        table[..., :3] = self.table(height)
        self.view.write(table.tobytes())


@lru_cache(maxsize=16)
def sky_table(air: Air, sun: Sun, height: float) -> Float64Array:
    """Return the clear sky's (128, 64, 3) radiance by direction, read-only, at a height (m).

    Columns: the angle from the sun's azimuth is 180° times the square of their share 0 … 1. Rows 0 to 63:
    in-scattered light over 1 − transmittance; the elevation is ±90° times the square of their share −1 … 1.
    Rows 64 to 127: the sky; 90° times the square of 0 … 1.
    """
    share = np.linspace(0.0, 1.0, SIZE)
    azimuth = np.pi * share**2
    around = np.linspace(-1.0, 1.0, SIZE)
    elevation = 0.5 * np.pi * np.concatenate([around * np.abs(around), share**2])[:, None]
    directions = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.broadcast_to(np.sin(elevation), (2 * SIZE, SIZE)),
        ],
        axis=-1,
    )
    low = np.radians(sun.elevation)
    to_sun = np.array([np.cos(low), 0.0, np.sin(low)])
    longest = np.minimum(LONGEST, RISE / np.maximum(directions[:SIZE, :, 2], 1e-6))
    haze = air.sky(height, directions[:SIZE], to_sun, steps=AIR_STEPS, longest=longest)
    sky = air.sky(height, directions[SIZE:], to_sun, steps=STEPS)
    table = np.concatenate([haze.radiance / (1.0 - haze.clear), sky.radiance]) * SUN_IRRADIANCE
    table.flags.writeable = False
    return np.asarray(table)


def overcast_table(irradiance: Float64Array) -> Float64Array:
    """Return `sky_table` under a closed cloud layer of a transmitted irradiance (3,).

    The zenith is three times as bright as the horizon (Moon & Spencer 1942, the CIE overcast sky).
    """
    rise = np.concatenate([np.zeros(SIZE), np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, SIZE) ** 2)])
    zenith = irradiance * 9.0 / (7.0 * np.pi)
    radiance = (1.0 + 2.0 * rise)[:, None, None] / 3.0 * zenith
    return np.broadcast_to(np.asarray(radiance, np.float64), (2 * SIZE, SIZE, 3))


def level_weight(height: float) -> tuple[int, float]:
    """Return the level below a height (m) and the weight of the next one, linear in the haze's density."""
    thin = -np.exp(-np.array(LEVELS) / AEROSOL_HEIGHT)
    place = float(np.interp(-np.exp(-height / AEROSOL_HEIGHT), thin, np.arange(len(LEVELS))))
    lower = min(int(place), len(LEVELS) - 2)
    return lower, place - lower


def _smooth(value: float, low: float, high: float) -> float:
    t = float(np.clip((value - low) / (high - low), 0.0, 1.0))
    return t * t * (3.0 - 2.0 * t)


ELEVATION: Final = 27.0  # degrees: long shadows that model the ground, and still the colours of day
TO_THE_SIDE: Final = 108.0  # degrees between view and sun: side light from a little behind the photographer
SHADOW_STEPS: Final = 28


def sun_for_view(terrain: TerrainSource, camera: Camera, weather: Weather) -> Sun:
    """Return the sun at the weather's hour, or the one that suits the view if no hour is set."""
    if weather.hour is None:
        return find_sun(terrain, camera)
    return sun_at(weather.hour, weather.latitude)


def sun_at(hour: float, latitude: float) -> Sun:
    """Return the sun at a local solar time (h) and latitude (degrees north) on the day of an equinox.

    It rises at 6 and sets at 18 everywhere, and its noon zenith angle is the latitude: neither steep and flat
    light as in midsummer nor a long twilight. Raise `InputError` below `LOWEST_SUN`.
    """
    angle, phi = np.radians((hour - 12.0) * 15.0), np.radians(latitude)
    east, north, up = -np.sin(angle), -np.sin(phi) * np.cos(angle), np.cos(phi) * np.cos(angle)
    elevation = float(np.degrees(np.arcsin(np.clip(up, -1.0, 1.0))))
    if elevation < LOWEST_SUN - 1e-9:
        half_day = float(np.degrees(np.arccos(np.sin(np.radians(LOWEST_SUN)) / np.cos(phi)))) / 15.0
        first, last = np.ceil((12.0 - half_day) * 60.0), np.floor((12.0 + half_day) * 60.0)
        raise InputError(
            f"expected an hour from {_clock(first)} to {_clock(last)}, while the sun stands no lower than "
            f"{LOWEST_SUN:g}° at latitude {latitude:g}°, got {_clock(round(hour * 60.0))}"
        )
    return Sun(float(np.degrees(np.arctan2(east, north))) % 360.0, max(elevation, LOWEST_SUN))


def _clock(minutes: float) -> str:
    return f"{int(minutes) // 60}:{int(minutes) % 60:02d}"


def find_sun(terrain: TerrainSource, camera: Camera) -> Sun:
    """Return the sun to the left or right of a camera, whichever lights more of its view; deterministic."""
    extent = terrain.extent
    ahead = camera.forward[:2] * 0.5 * extent
    middle = camera.eye[0] + ahead[0], camera.eye[1] + ahead[1]
    relief = sample_heights(terrain, middle, 2.4 * extent, 320, cell=2.0)  # as coarse as `find_view` needs it
    bearing = np.radians(camera.heading) + np.linspace(-0.5, 0.5, 41)[:, None]
    distance = extent * np.geomspace(0.02, 1.3, 48)[None, :]
    x = camera.eye[0] + np.sin(bearing) * distance
    y = camera.eye[1] + np.cos(bearing) * distance
    slope = (relief.at(x, y) - camera.eye[2]) / distance
    skyline = np.maximum.accumulate(slope, axis=1)
    in_picture = np.maximum(slope - np.concatenate([skyline[:, :1], skyline[:, :-1]], axis=1), 0.0)
    suns = [Sun((camera.heading + side * TO_THE_SIDE) % 360.0, ELEVATION) for side in (-1.0, 1.0)]
    lit = [float(np.sum(in_picture * _lit(relief, sun, x, y))) for sun in suns]
    return suns[int(np.argmax(lit))]


def _lit(relief: HeightMap, sun: Sun, x: Float64Array, y: Float64Array) -> Float64Array:
    """Return the cosine of incidence on the ground, 0 in the shadow of other ground."""
    east, north, up = sun.direction
    h, d = relief.at(x, y), relief.texel
    slope_x = (relief.at(x + d, y) - relief.at(x - d, y)) / (2 * d)
    slope_y = (relief.at(x, y + d) - relief.at(x, y - d)) / (2 * d)
    cosine = (up - slope_x * east - slope_y * north) / np.sqrt(1.0 + slope_x**2 + slope_y**2)
    free = np.ones(x.shape, dtype=np.bool_)
    for run in d * np.geomspace(1.5, 160.0, SHADOW_STEPS):
        free &= relief.at(x + east * run, y + north * run) <= h + up * run + 0.5 * d
    return np.asarray(np.maximum(cosine, 0.0) * free)
