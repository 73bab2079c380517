"""Stage 1 (Zaaijer 2013 §4.2): a painted shape becomes point features, its user features.

Summits come first: `multitude` of them, thrown like darts. Support follows: discs along the medial axis that
cover the shape as far as the fidelity asks, lower than the summits, so that a long range is one ridge.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.features.hashing import hashed, smooth_noise, unit
from sketchterrain.features.rules import LAYER_CODES, TYPES
from sketchterrain.features.shapes import Shape

USER_FEATURE = np.dtype(
    [
        ("id", "u8"),  # layer code · 2⁴⁸ + pixel index
        ("type", "u1"),
        ("label", "u1"),
        ("row", "i4"),
        ("column", "i4"),
        ("disc", "f8"),  # px, radius of the part of the shape that it stands for
        ("share", "f8"),  # of the label's strength
        ("summit", "?"),
    ]
)
"""A user feature; positions are pixels of the sketch."""

LEAST_DISC = 1.0
"""Radius (px) of the smallest disc: even a lone pixel must show."""

_DARTS_EACH = 64  # darts thrown for each summit asked for, before giving up
_CHUNK = 4096  # pixels looked at together when the next free one is sought

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def pixel_id(layer: str, row: Ints, column: Ints, image_width: int) -> npt.NDArray[np.uint64]:
    """Stable id of what stands on a pixel of a layer; its top bit is clear."""
    index = np.asarray(row).astype(np.int64) * image_width + np.asarray(column)
    return np.asarray(index + (LAYER_CODES[layer] << 48)).astype(np.uint64)


def mean_size(area: int, multitude: int) -> float:
    """Radius (px) of each of `multitude` equal discs with the shape's area, in steps of 2^(1/8).

    The steps keep a dab at a shape's edge from changing all of its features.
    """
    radius = max(math.sqrt(area / (math.pi * multitude)), LEAST_DISC)
    return float(2.0 ** (round(8.0 * math.log2(radius)) / 8.0))


def user_features(shape: Shape, *, multitude: int, fidelity: float, seed: int) -> npt.NDArray[np.void]:
    """Break a shape into user features.

    Parameters
    ----------
    shape : Shape
        Of a layer of point features.
    multitude : int
        How many summits to aim for, 1 or more. Fewer come where the shape has no room; never none.
    fidelity : float
        0 … 1: how much of the shape the union of the discs shall cover, from 60 % to 98 %.
    seed : int
        Seed of the terrain.

    Returns
    -------
    Array of ``USER_FEATURE``, summits first. Depends on nothing but this shape and the arguments.
    """
    mean = mean_size(shape.area, multitude)
    rows, columns = np.nonzero(shape.mask)
    depth = shape.depth[rows, columns]
    disc = np.maximum(np.minimum(depth, 1.25 * mean), LEAST_DISC)
    at_row, at_column = rows + int(shape.rows.start), columns + int(shape.columns.start)
    pixel = at_row.astype(np.int64) * shape.image_width + at_column
    priority = hashed(seed, "dart", LAYER_CODES[shape.layer], shape.label, pixel)

    summits = _summits(shape, rows, columns, depth, disc, priority, mean, multitude)
    support = _support(shape, rows, columns, disc, priority, summits, fidelity)
    chosen = np.concatenate([summits, support])

    result = np.zeros(len(chosen), dtype=USER_FEATURE)
    result["row"], result["column"] = at_row[chosen], at_column[chosen]
    result["id"] = pixel_id(shape.layer, at_row[chosen], at_column[chosen], shape.image_width)
    result["type"], result["label"] = LAYER_CODES[shape.layer], shape.label
    result["disc"] = disc[chosen]
    result["summit"][: len(summits)] = True
    result["share"] = _shares(shape, result, seed)
    return result


def _summits(
    shape: Shape,
    rows: Ints,
    columns: Ints,
    depth: Floats,
    disc: Floats,
    priority: npt.NDArray[np.uint64],
    mean: float,
    multitude: int,
) -> Ints:
    """Darts in order of their priority, farther apart first, then closer until there are enough."""
    deepest = float(depth.max())
    peak = (shape.depth == ndimage.maximum_filter(shape.depth, size=3, mode="constant"))[rows, columns]
    usable = (peak & (depth >= 0.75 * min(mean, deepest))) | (depth >= min(mean, 0.9 * deepest))
    darts = np.flatnonzero(usable)
    most = _DARTS_EACH * (multitude + 4)
    if len(darts) > most:
        darts = darts[np.argpartition(priority[darts], most)[:most]]
    darts = darts[np.argsort(priority[darts], kind="stable")]

    # In a thin shape summits stand along a line, so that its length, not its area, spaces them.
    spacing = max(1.7 * mean, 0.6 * shape.area / (2.0 * max(deepest, 0.5) * multitude))
    accepted: list[int] = []
    covered = 0.0
    for _ in range(6):
        free = np.ones(len(darts), dtype=np.bool_)
        for index in accepted:
            free &= _apart(rows, columns, darts, index, spacing)
        while free.any() and len(accepted) < multitude and (covered < shape.area or not accepted):
            index = int(darts[np.argmax(free)])
            accepted.append(index)
            covered += math.pi * float(disc[index]) ** 2
            free &= _apart(rows, columns, darts, index, spacing)
        if len(accepted) >= multitude or covered >= shape.area:
            break
        spacing *= 0.75
    return np.asarray(accepted, dtype=np.int64)


def _apart(rows: Ints, columns: Ints, darts: Ints, index: int, spacing: float) -> npt.NDArray[np.bool_]:
    down, across = rows[darts] - rows[index], columns[darts] - columns[index]
    apart: npt.NDArray[np.bool_] = down * down + across * across >= max(spacing * spacing, 1.0)
    return apart


def _support(
    shape: Shape,
    rows: Ints,
    columns: Ints,
    disc: Floats,
    priority: npt.NDArray[np.uint64],
    summits: Ints,
    fidelity: float,
) -> Ints:
    """Discs on the medial axis, largest first, until the union covers what the fidelity asks."""
    cover = _Cover(shape, rows, columns, disc, fidelity)
    for index in summits:
        cover.add(int(index))
    candidates = np.flatnonzero(_medial(shape, rows, columns, disc, cover.least_disc))
    # Steps of a quarter pixel: among discs of about one size the hash decides, not the reading order.
    order = candidates[np.lexsort((priority[candidates], -np.round(4.0 * disc[candidates])))]
    accepted: list[int] = []
    position = 0
    while position < len(order) and not cover.enough:
        free = ~cover.blocked[order[position : position + _CHUNK]]
        if not free.any():
            position += _CHUNK
            continue
        position += int(np.argmax(free))
        index = int(order[position])
        cover.add(index)
        accepted.append(index)
        position += 1
    return np.asarray(accepted, dtype=np.int64)


class _Cover:
    """Which of a shape's pixels are covered, and which are no longer worth a disc of their own."""

    def __init__(self, shape: Shape, rows: Ints, columns: Ints, disc: Floats, fidelity: float) -> None:
        self._number = np.full(shape.mask.shape, -1, dtype=np.int64)
        self._number[rows, columns] = np.arange(len(rows))
        self._covered = np.zeros(len(rows), dtype=np.bool_)
        self._rows, self._columns, self._disc = rows, columns, disc
        self._left = round((1.0 - (0.6 + 0.38 * fidelity)) * len(rows))
        self._to_cover = len(rows)
        self._swallow = 1.05 + 0.35 * (1.0 - fidelity)
        self._spacing = 0.5 + 0.4 * (1.0 - fidelity)
        self.least_disc = 0.3 * (1.0 - fidelity) * float(disc.max())
        self.blocked = np.zeros(len(rows), dtype=np.bool_)

    @property
    def enough(self) -> bool:
        return self._to_cover <= self._left

    def add(self, index: int) -> None:
        """Cover a pixel's disc; block pixels close to its centre and those whose discs it swallows."""
        row, column, disc = int(self._rows[index]), int(self._columns[index]), float(self._disc[index])
        reach = math.ceil(self._swallow * disc + 1.0)
        window = self._number[
            max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1
        ]
        near = window[window >= 0]
        distance = np.hypot(self._rows[near] - row, self._columns[near] - column)
        newly = near[(distance < disc + 0.5) & ~self._covered[near]]
        self._covered[newly] = True
        self._to_cover -= len(newly)
        swallowed = distance + self._disc[near] <= self._swallow * disc + 0.5
        self.blocked[near[swallowed | (distance <= self._spacing * disc)]] = True


def _medial(
    shape: Shape, rows: Ints, columns: Ints, disc: Floats, least_disc: float
) -> npt.NDArray[np.bool_]:
    """Pixels whose disc no neighbour's disc nearly contains; thinned to a lattice where discs are capped."""
    size = np.zeros(shape.mask.shape)
    size[rows, columns] = disc
    padded = np.pad(size, 1)
    contained = np.zeros(shape.mask.shape, dtype=np.bool_)
    height, width = size.shape
    for down, across in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        neighbour = padded[1 + down : 1 + down + height, 1 + across : 1 + across + width]
        contained |= neighbour - size >= 0.8 * math.hypot(down, across)
    largest = float(disc.max())
    step = max(1, int(largest / 6.0))
    on_lattice = ((rows + int(shape.rows.start)) % step == 0) & (
        (columns + int(shape.columns.start)) % step == 0
    )
    medial: npt.NDArray[np.bool_] = ~contained[rows, columns] & (disc >= least_disc)
    return medial & ((disc < largest) | on_lattice)


def _shares(shape: Shape, features: npt.NDArray[np.void], seed: int) -> Floats:
    """Strength relative to the label's: the largest summit has it whole."""
    rule = TYPES[shape.layer]
    disc, summit = features["disc"], features["summit"]
    largest = float(disc[summit].max())
    size = np.minimum(disc / largest, 1.0) ** rule.size_power
    scale = 2.5 * largest
    swing = smooth_noise(seed, f"{shape.layer} support", features["column"] / scale, features["row"] / scale)
    low, high = rule.support
    share = np.where(summit, 1.0, low + (high - low) * swing) * size
    pixel = features["id"].astype(np.uint64)
    varied: Floats = share * (1.0 + rule.variation * (2.0 * unit(seed, "strength", pixel) - 1.0))
    return varied
