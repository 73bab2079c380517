"""How far, in pixels, drawn triangles stand from the terrain: a depth test in NumPy and a projection."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera

_PAIRS = 1 << 20  # of a triangle and a sample, looked at together
_NEAREST = 1e-6  # m ahead of the eye
_SLACK = 1e-6  # of a step between samples; what rounding may have moved


class PictureSize(NamedTuple):
    """Width and height in pixels."""

    width: int
    height: int

    def pixels_per_radian(self, camera: Camera) -> float:
        """Return the pixels that an angle of 1 covers in the middle of the picture."""
        return self.height / (2.0 * float(np.tan(np.radians(camera.fov) / 2.0)))


class ScreenSamples:
    """What a picture shows of triangles at some of its pixels.

    A sample is a ray from the eye. It meets the triangle A, B, C (relative to the eye) where its products
    with B × C, C × A and A × B have one sign, that of A · (B × C); so nothing needs to be clipped, and
    triangles that share an edge leave no gap.
    """

    def __init__(self, camera: Camera, picture: PictureSize, *, every: int = 4) -> None:
        if every < 1 or min(picture) < every:
            raise InputError(f"expected a sample each 1 … {min(picture)} pixels, got {every}")
        self._eye = np.asarray(camera.eye, np.float64)
        self._axes = camera.view()[:3, :3] * np.array([[1.0], [1.0], [-1.0]])  # right, up, ahead
        scale = picture.pixels_per_radian(camera)
        columns, rows = (
            np.arange(every // 2, picture.width, every),
            np.arange(every // 2, picture.height, every),
        )
        self._u = (columns + 0.5 - picture.width / 2) / scale
        self._v = (rows + 0.5 - picture.height / 2) / scale
        self._depth = np.full(len(rows) * len(columns), np.inf)

    @property
    def count(self) -> int:
        """Samples, those of the sky included."""
        return self._depth.size

    def add(self, vertices: npt.ArrayLike, triangles: npt.ArrayLike) -> None:
        """Draw triangles, which hide what lies behind them."""
        at = (np.asarray(vertices, np.float64) - self._eye) @ self._axes.T
        corners = np.asarray(triangles, np.int64)
        behind = at[:, 2] < _NEAREST
        first, last = self._bounds(at, behind, corners)
        kept = np.flatnonzero((first <= last).all(axis=0))
        if behind.any():
            kept = kept[self._in_view(at, corners[kept])]
        self._draw(at, corners[kept], first[:, kept], last[:, kept])

    def seen(self) -> Float64Array:
        """Return the points that the samples see, m, shape (k, 3); those that see none have no point."""
        v, u = (axis.ravel() for axis in np.meshgrid(self._v, self._u, indexing="ij"))
        hit = np.isfinite(self._depth)
        ahead = np.stack([u, v, np.ones_like(u)], axis=-1)[hit] * self._depth[hit, None]
        return np.asarray(self._eye + ahead @ self._axes)

    def _bounds(
        self, at: Float64Array, behind: npt.NDArray[np.bool_], corners: Int64Array
    ) -> tuple[Int64Array, Int64Array]:
        """Return the first and last column and row of samples that each triangle may cover, shape (2, m)."""
        bounds = []
        for which, axis in enumerate((self._u, self._v)):
            step = axis[1] - axis[0] if axis.size > 1 else 1.0
            place = (at[:, which] / np.where(behind, 1.0, at[:, 2]) - axis[0]) / step
            place = place.clip(-1.0, axis.size)
            # What reaches behind the eye has no outline: anywhere.
            low = np.where(behind, 0, np.ceil(place - _SLACK).astype(np.int64))
            high = np.where(behind, axis.size - 1, np.floor(place + _SLACK).astype(np.int64))
            a, b, c = (np.ascontiguousarray(corners[:, i]) for i in range(3))
            first = np.minimum(np.minimum(low[a], low[b]), low[c]).clip(0)
            last = np.maximum(np.maximum(high[a], high[b]), high[c]).clip(None, axis.size - 1)
            bounds.append((first, last))
        return np.stack([bounds[0][0], bounds[1][0]]), np.stack([bounds[0][1], bounds[1][1]])

    def _in_view(self, at: Float64Array, corners: Int64Array) -> npt.NDArray[np.bool_]:
        """Tell which triangles are not wholly outside one side of the picture, as far as samples go."""
        x, y, w = at[:, 0], at[:, 1], at[:, 2]
        sides = (x - self._u[-1] * w, self._u[0] * w - x, y - self._v[-1] * w, self._v[0] * w - y, -w)
        kept = np.ones(len(corners), np.bool_)
        for side in sides:
            kept &= (side[corners] <= _SLACK * np.abs(side).max(initial=0.0)).any(axis=1)
        return kept

    def _draw(self, at: Float64Array, corners: Int64Array, first: Int64Array, last: Int64Array) -> None:
        wide, high = last - first + 1
        count = wide * high
        a, b, c = (at[corners[:, i]] for i in range(3))
        edges = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        volume = np.einsum("ij,ij->i", a, edges[:, 0])
        edges *= np.sign(volume)[:, None, None]
        for group in _groups(count):
            which = np.repeat(np.arange(group.start, group.stop), count[group])
            place = np.arange(len(which)) - np.repeat(np.cumsum(count[group]) - count[group], count[group])
            column = first[0, which] + place % wide[which]
            row = first[1, which] + place // wide[which]
            ray = np.stack([self._u[column], self._v[row], np.ones(len(which))], axis=-1)
            within = np.einsum("kij,kj->ki", edges[which], ray)
            whole = within.sum(axis=1)
            hit = (within >= 0).all(axis=1) & (whole > 0)
            depth = np.abs(volume[which[hit]]) / whole[hit]
            np.minimum.at(self._depth, row[hit] * len(self._u) + column[hit], depth)


def _groups(count: Int64Array) -> Iterator[slice]:
    """Yield runs of triangles with about as many samples each as are looked at together."""
    ends = np.cumsum(count)
    start = 0
    while start < len(count):
        done = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + _PAIRS, "right")))
        yield slice(start, stop)
        start = stop


def screen_distances(
    camera: Camera, picture: PictureSize, drawn: Float64Array, heights: npt.ArrayLike
) -> Float64Array:
    """Return how far apart in the picture drawn points and the terrain's lie that stand at the same x, y."""
    true = np.column_stack([drawn[:, :2], np.asarray(heights, np.float64)])
    scale = picture.pixels_per_radian(camera)
    axes = camera.view()[:3, :3]
    places = []
    for points in (drawn, true):
        x, y, back = ((points - np.asarray(camera.eye)) @ axes.T).T
        ahead = np.where(back < 0, -back, np.nan)
        places.append(np.stack([x, y]) / ahead * scale)
    return np.asarray(np.nan_to_num(np.hypot(*(places[1] - places[0])), nan=np.inf))


@dataclass(frozen=True)
class ErrorSummary:
    """What distances in a picture come to."""

    samples: int
    within: float
    most: float
    worst: float

    @classmethod
    def of(cls, distances: Float64Array) -> ErrorSummary:
        """Sum up at least one distance, pixels."""
        ordered = np.sort(distances)
        most = float(ordered[-(-999 * ordered.size // 1000) - 1])
        return cls(ordered.size, float(np.mean(ordered <= 1.0)), most, float(ordered[-1]))
