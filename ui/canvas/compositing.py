"""Compositing of label layers: tiled colour images with codes of the painted layers, and hatch patterns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.caching import LRUCache
from sketchterrain.document.label_layers import Box, LabelImage, union_box
from sketchterrain.schema.layers import DRAW_ORDER, LAYERS, PAINTED_LAYERS
from sketchterrain.ui.look.layer_colours import hatch, hatch_colour, hatch_period, label_colour
from sketchterrain.ui.models.workspace import Workspace

Colours: TypeAlias = npt.NDArray[np.uint32]
Codes: TypeAlias = npt.NDArray[np.uint32]
Floats: TypeAlias = npt.NDArray[np.float32]

MASK: Final = (1 << len(PAINTED_LAYERS)) - 1
"""Code bits of painted layers, bit i for the i-th `LayerPaint`; the other bits are a hash of the labels."""

_TILE = 256  # px of a level along a tile's side
_MAX_TILES = 240  # 126 MB
_HASH_FACTORS = np.random.default_rng(1).integers(
    2**32, size=len(PAINTED_LAYERS), dtype=np.uint32
) | np.uint32(1)
_HASH_BITS = np.uint32(0xFFFF0000)
_MAX_MIXTURES = 4096  # label combinations of a look-up table


@dataclass(frozen=True, eq=False)
class LayerPaint:
    """Colours and opacity of a layer."""

    layer: str
    colours: Floats  # red, green and blue by label, 0 … 1
    opacity: float  # 0 … 1


def level_for(scale: float) -> int:
    """Return the finest level whose pixels are at least a screen pixel large at a scale (see `Viewport`)."""
    return 0 if scale >= 1.0 else int(np.ceil(-np.log2(scale) - 1e-9))


class LayerCompositor:
    """The visible layers composited in tiles on demand.

    A pixel of level l covers 2^l × 2^l sketch pixels and has each layer's greatest label there, so that thin
    features stay visible from afar.
    """

    def __init__(self, layer: Callable[[str], LabelImage], paints: Sequence[LayerPaint] = ()) -> None:
        self._layer = layer
        self.paints = tuple(paints)  # of the visible layers from bottom to top
        self._tiles = LRUCache(_MAX_TILES)  # by level, row and column

    def invalidate(self, box: Box | None = None) -> None:
        """Mark a box of the sketch as stale, or everything."""
        if box is None:
            self._tiles = LRUCache(_MAX_TILES)
            return
        for (level, row, column), tile in self._tiles.items():
            step, side = 1 << level, _TILE << level
            top, left = row * side, column * side
            first = (box[0] - top) // step, (box[1] - left) // step
            last = -((top - box[2]) // step), -((left - box[3]) // step)
            tile.stale = union_box(tile.stale, _clip(*first, *last))

    def read(self, level: int, box: Box) -> tuple[Colours, Codes]:
        """Return colours and codes of a level in a box of its rows and columns."""
        top, left, bottom, right = box
        colours = np.empty((bottom - top, right - left), np.uint32)
        codes = np.empty(colours.shape, np.uint32)
        for row in range(top // _TILE, -(-bottom // _TILE)):
            for column in range(left // _TILE, -(-right // _TILE)):
                tile = self._tile(level, row, column)
                north, west = row * _TILE, column * _TILE
                first = (max(top, north), max(left, west))
                last = (min(bottom, north + _TILE), min(right, west + _TILE))
                there = np.s_[first[0] - top : last[0] - top, first[1] - left : last[1] - left]
                here = np.s_[first[0] - north : last[0] - north, first[1] - west : last[1] - west]
                colours[there], codes[there] = tile.colours[here], tile.codes[here]
        return colours, codes

    def _tile(self, level: int, row: int, column: int) -> _Tile:
        tile = self._tiles.get_or_compute((level, row, column), _Tile)
        if tile.stale is None:
            return tile
        (top, left, bottom, right), tile.stale = tile.stale, None
        north, west = row * _TILE, column * _TILE
        area = np.s_[
            north + top << level : north + bottom << level, west + left << level : west + right << level
        ]
        tile.colours[top:bottom, left:right] = tile.codes[top:bottom, left:right] = 0
        images = {bit: self._layer(paint.layer)[area] for bit, paint in enumerate(self.paints)}
        paints = {bit: self.paints[bit] for bit, image in images.items() if image.max(initial=0) > 0}
        if paints:  # few in most places
            labels = [_reduce(images[bit], level) for bit in paints]
            height, width = labels[0].shape  # less at the sketch's edges
            here = np.s_[top : top + height, left : left + width]
            tile.colours[here], tile.codes[here] = _blend(paints, labels)
        return tile


class _Tile:
    """Pixels of a level, and their stale box."""

    def __init__(self) -> None:
        self.colours: Colours = np.zeros((_TILE, _TILE), np.uint32)
        self.codes: Codes = np.zeros((_TILE, _TILE), np.uint32)
        self.stale: Box | None = (0, 0, _TILE, _TILE)


def _clip(top: int, left: int, bottom: int, right: int) -> Box | None:
    """Return the part of a box inside a tile."""
    top, left, bottom, right = max(top, 0), max(left, 0), min(bottom, _TILE), min(right, _TILE)
    return (top, left, bottom, right) if top < bottom and left < right else None


def _reduce(image: LabelImage, level: int) -> LabelImage:
    """Return the greatest label of every 2^level × 2^level pixels, fewer at the right and bottom edges."""
    if level == 0:
        return image
    step, whole = 1 << level, image.shape[0] >> level
    rows: LabelImage = image[: whole * step].reshape(whole, step, -1).max(axis=1, initial=0)
    if image.shape[0] % step:
        rows = np.concatenate([rows, image[whole * step :].max(axis=0, keepdims=True)])
    image = rows
    for _ in range(level):
        if image.shape[1] % 2:
            image = np.concatenate([image, image[:, -1:]], axis=1)
        image = np.maximum(image[:, 0::2], image[:, 1::2])
    return image


def _mixtures(images: Sequence[LabelImage]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the number of each pixel's mixture of labels, and a pixel of each mixture."""
    number, count = np.zeros(images[0].shape, np.intp), 1
    for image in images:
        labels = int(image.max()) + 1
        number *= labels
        number += image
        count *= labels
        if count > _MAX_MIXTURES:
            kept, found = np.unique(number, return_inverse=True)
            number, count = found.reshape(number.shape), len(kept)
    pixel = np.zeros(count, np.intp)
    pixel[number.ravel()] = np.arange(number.size)
    return number, pixel


def _blend(paints: Mapping[int, LayerPaint], images: Sequence[LabelImage]) -> tuple[Colours, Codes]:
    """Return colours and codes of the labels of layers, given by their bits."""
    number, pixel = _mixtures(images)
    colour = np.zeros((len(pixel), 4), np.float32)
    mask, hashes = np.zeros(len(pixel), np.uint32), np.zeros(len(pixel), np.uint32)
    for (bit, paint), image in zip(paints.items(), images, strict=True):
        labels = image.ravel()[pixel]
        cover = np.where(labels > 0, np.float32(paint.opacity), np.float32(0.0))[:, None]
        colour += (np.insert(paint.colours, 3, 1.0, axis=1)[labels] - colour) * cover
        mask |= (labels > 0).astype(np.uint32) << np.uint32(bit)
        hashes += labels * _HASH_FACTORS[bit]
    red, green, blue, alpha = np.rint(255.0 * colour).astype(np.uint32).T
    hashes = (hashes ^ hashes >> np.uint32(13)) * np.uint32(2246822519)
    return (alpha << 24 | red << 16 | green << 8 | blue)[number], (mask | hashes & _HASH_BITS)[number]


_UNDERLYING = 0.35  # strength of a hatch below another layer
_OUTLINE = (30, 26, 22)  # red, green, blue
_OUTLINE_OPACITY = 0.5


class HatchTable:
    """Renders hatches and outlines from codes by table look-up."""

    def __init__(self, paints: Sequence[LayerPaint], ratio: float) -> None:
        self._period = hatch_period(ratio)
        self._table = _table(paints, self._period)
        self.halo = max(round(ratio), 1)  # px around the target whose codes are needed: an outline's width
        red, green, blue = (round(part * _OUTLINE_OPACITY) for part in _OUTLINE)
        self._outline = np.uint32(round(255 * _OUTLINE_OPACITY) << 24 | red << 16 | green << 8 | blue)

    def render(self, codes: Codes, x: int, y: int) -> Colours:
        """Return hatches and outlines of codes at a screen position (px, for the pattern's phase)."""
        halo, period = self.halo, self._period
        inner = codes[halo:-halo, halo:-halo]
        height, width = inner.shape
        across = (np.arange(x, x + width) % period).astype(np.uint32)
        down = (np.arange(y, y + height) % period).astype(np.uint32) * np.uint32(period)
        index = (inner & np.uint32(MASK)) * np.uint32(period * period)
        index += across
        index += down[:, None]
        pixels: Colours = np.take(self._table, index)
        changed = np.zeros(inner.shape, bool)
        for step in range(halo):
            first = codes[halo:-halo, halo - step : width + halo - step]
            changed |= first != codes[halo:-halo, halo - step + 1 : width + halo - step + 1]
            first = codes[halo - step : height + halo - step, halo:-halo]
            changed |= first != codes[halo - step + 1 : height + halo - step + 1, halo:-halo]
        pixels[changed] = self._outline
        return pixels


def _table(paints: Sequence[LayerPaint], period: int) -> Colours:
    """Return premultiplied pixels by mask, row and column, flattened."""
    colour = np.zeros((MASK + 1, period, period, 3), np.float32)
    alpha = np.zeros((MASK + 1, period, period, 1), np.float32)
    masks = np.arange(MASK + 1)
    for bit, paint in enumerate(paints):
        painted = (masks >> bit & 1) == 1
        line = hatch_colour(paint.layer)
        strength = line.alphaF() * (0.4 + 0.6 * paint.opacity)  # readable where the paint is thin, too
        cover = hatch(LAYERS[paint.layer].hatch, period)[None, :, :, None] * np.float32(strength)
        below = (1.0 - cover) * np.float32(_UNDERLYING)
        colour[painted] = colour[painted] * below + np.array(line.getRgb()[:3], np.float32) * cover
        alpha[painted] = alpha[painted] * below + cover
    red, green, blue = np.moveaxis(np.rint(colour).astype(np.uint32), -1, 0)
    packed = np.rint(255.0 * alpha[..., 0]).astype(np.uint32) << np.uint32(24)
    table: npt.NDArray[np.uint32] = packed | red << np.uint32(16) | green << np.uint32(8) | blue
    return table.ravel()


def visible_layers(workspace: Workspace) -> tuple[str, ...]:
    """Return the visible layers from bottom to top."""
    looks = {name: workspace.look(name) for name in DRAW_ORDER}
    return tuple(name for name, look in looks.items() if look.visible and look.opacity > 0.0)


def paints_of(workspace: Workspace) -> tuple[LayerPaint, ...]:
    """Return the visible layers' paints from bottom to top."""
    return tuple(
        LayerPaint(name, _colours(name), workspace.look(name).opacity) for name in visible_layers(workspace)
    )


@lru_cache(maxsize=16)
def _colours(layer: str) -> Floats:
    colours = np.zeros((256, 3), np.float32)
    for label in range(1, 256):
        colour = label_colour(layer, label)
        colours[label] = colour.redF(), colour.greenF(), colour.blueF()
    colours.flags.writeable = False
    return colours
