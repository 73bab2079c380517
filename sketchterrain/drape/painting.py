"""Appearance tiles with draped layers: parts of features, listed by blocks of texels, for a kernel."""

from __future__ import annotations

from collections.abc import Container, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import product
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, FloatArray, Int32Array, UInt8Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import BLENDS, STYLE, DrapedLayer
from sketchterrain.features.items import Items
from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.look.texture_maker import linear_from_hex
from sketchterrain.terrain.appearance import SIDE, AppearanceSource, known_tiles, tile_boxes
from sketchterrain.terrain.orthophotos import ROOTS
from sketchterrain.terrain.orthophotos import WHITE as PICTURE_WHITE

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.drape.drapes import Drapes, LayerStyle
    from sketchterrain.generation.terrain import Terrain

WHITE: Final = 0.8
"""Albedo of white in styles: that of paper, so that colours keep below what sunlit ground can reflect."""
TEXEL_PIXELS: Final = 1.1 * 0.5**0.5
"""Pixels of a texel, for widths in px: the geometric mean of the 0.55 … 1.1 px at which tiles are drawn."""
_FILE: Final = "drape.cl"
_STYLE: Final = kernel_columns("drape.clh", "DrapeStyle")
_ROOTS: Final = np.rint(255.0 * ROOTS).astype(np.uint8)  # of the albedo of pixels, 255 for white
_BLOCK, _PICTURE = (int(each) for each in kernel_constants(_FILE, "DRAPE_BLOCK", "ENTRY_PICTURE"))
_BLOCKS: Final = SIDE // _BLOCK
_CAPS, _JOIN_NAMES = (STYLE[name].choices for name in ("cap", "join"))
_PIECE: Final = kernel_columns("drape.clh", "DrapePiece")
_FIRST_DASH: Final = 24
_LENGTHS: Final = [
    *(_STYLE[f"style_{name}"] for name in ("half_width", "hatch_spacing", "dash_period")),
    *range(_FIRST_DASH, _FIRST_DASH + 16),
]
_MAX_TILES: Final = 32  # in a launch
_BASES, _LISTS = 6 << 20, 10 << 20  # bytes of tiles below, and of lists, in memory
_EVERYWHERE: Final = np.array([[-np.inf, -np.inf, np.inf, np.inf]])
_UNKNOWN_GROUND: Final = 0.2  # albedo below layers that filter it, where a picture has no ground


class _Scale(NamedTuple):
    """Metres of a texel and of a pixel."""

    texel: float
    pixel: float


class _Lists(NamedTuple):
    """Parts of a layer near a tile. Styles are numbers of classes in the layer."""

    pieces: FloatArray  # (m, 8) rows of `DrapePiece` without places in dashes
    along: Float64Array  # (m,) texels along the line to each of them
    style: Int32Array  # (m,)
    block: Int32Array  # (e,) of each entry
    entries: Int32Array  # (e, 4) style, kind, first in `numbers`, count
    numbers: Int32Array  # (k,) of pieces


class _Styles:
    """Rows of `DrapeStyle` of classes, then of each layer as a raster, with lengths in their units."""

    def __init__(self, styles: Sequence[LayerStyle], layers: Sequence[DrapedLayer]) -> None:
        rows = [_style_row(each) for each in styles]
        for number, layer in enumerate(layers):
            look = {"style_opacity": layer["opacity"], "style_blend": BLENDS.index(layer["blend"])}
            rows.append(_row(**look, style_white=PICTURE_WHITE, style_layer=number))
        self._rows = np.array(rows, np.float64).reshape(len(styles) + len(layers), -1)
        self.in_pixels = np.zeros(len(self._rows), np.bool_)
        self.in_pixels[: len(styles)] = [each.style["unit"] == "px" for each in styles]
        square = self._rows[:, _STYLE["style_cap"]] == _CAPS.index("square")
        self.reach = self._rows[:, _STYLE["style_half_width"]] * np.where(square, np.sqrt(2.0), 1.0)
        self.is_mitred = self._rows[:, _STYLE["style_join"]] == _JOIN_NAMES.index("mitre")
        first = np.array([each.layer for each in styles], np.int64)
        self.first = np.searchsorted(first, np.arange(len(layers)))  # row of each layer

    def units(self, view: _Scale) -> Float64Array:
        """Return the texels of the unit of each row."""
        return np.where(self.in_pixels, view.pixel, 1.0) / view.texel

    def rows(self, view: _Scale) -> Float64Array:
        """Return the rows with lengths in texels."""
        result = self._rows.copy()
        result[:, _LENGTHS] *= self.units(view)[:, None]
        return result


@dataclass(frozen=True, eq=False)
class DrapedAppearance:
    """Colour of draped layers over what is painted below, if anything; see `terrain.appearance.Appearance`.

    A tile depends on its key alone. Widths in px are right in the mean of the scales at which it is drawn.
    """

    drapes: Drapes
    context: ComputeContext
    extent: float
    below: AppearanceSource | None = None
    _bases: LRUCache = field(default_factory=partial(LRUCache, max_bytes=_BASES), repr=False)
    _lists: LRUCache = field(default_factory=partial(LRUCache, max_bytes=_LISTS), repr=False)

    def updated(self, drapes: Drapes, below: AppearanceSource | None) -> DrapedAppearance:
        """Return the appearance of other layers or ground; what is listed for unchanged layers is shared."""
        if below is not self.below:
            return DrapedAppearance(drapes, self.context, self.extent, below, _lists=self._lists)
        return replace(self, drapes=drapes)

    @property
    def is_empty(self) -> bool:
        """Whether nothing is painted anywhere."""
        return self.drapes.is_empty and (self.below is None or self.below.is_empty)

    @cached_property
    def filters(self) -> bool:
        """Whether a layer is unlit, or blends otherwise than by opacity: tiles have twice the channels."""
        unlit = {each.layer for each in self.drapes.styles if each.style["unlit"]}
        pairs = enumerate(self.drapes.layers)
        return any(each["visible"] and (each["blend"] != "normal" or at in unlit) for at, each in pairs)

    @cached_property
    def reach(self) -> float:
        """Texels around features of a width in px that may be painted."""
        reaches = [each.reach(1.0) for each in self.drapes.styles if each.style["unit"] == "px"]
        return 1.0 + max(reaches, default=0.0) / TEXEL_PIXELS

    @property
    def nbytes(self) -> int:
        """Bytes of lists and of tiles below that are kept."""
        return self._lists.nbytes + self._bases.nbytes

    def occupied(self, keys: npt.ArrayLike) -> BoolArray:
        """Return whether anything may be painted in tiles (n, 3) of level, column and row, (n,)."""
        tiles = np.asarray(keys, np.int64).reshape(-1, 3)
        result = known_tiles(
            self._known_occupied, tiles, lambda new: self.drapes.occupied(tile_boxes(new, self.extent))
        )
        return result if self.below is None else result | self.below.occupied(tiles)

    @cached_property
    def _known_occupied(self) -> dict[tuple[int, ...], bool]:
        return {}

    def changed_areas(self, old: AppearanceSource) -> Float64Array:
        """Return boxes (n, 4), m, outside of which tiles of an earlier appearance are equal.

        Widths in px add `reach` texels.
        """
        if not isinstance(old, DrapedAppearance) or (old.below is None) != (self.below is None):
            return _EVERYWHERE
        boxes = self.drapes.changed_boxes(old.drapes)
        if self.below is None or self.below is old.below:
            return boxes
        return np.concatenate([boxes, self.below.changed_areas(old.below)])

    def tiles(self, keys: npt.ArrayLike) -> UInt8Array:
        """Return tiles (n, SIDE, SIDE, 4), as `terrain.appearance.Appearance` does.

        If the appearance `filters`, 8: how much of the ground's red, green and blue is seen, and what is lit.
        """
        tiles = np.asarray(keys, np.int64).reshape(-1, 3)
        result = np.zeros((len(tiles), SIDE, SIDE, 8 if self.filters else 4), np.uint8)
        for level in np.unique(tiles[:, 0]).tolist():
            (own,) = np.nonzero(tiles[:, 0] == level)
            width = self.extent / 2.0**level
            texel = width / (SIDE - 2)
            for part in np.array_split(own, -(-len(own) // _MAX_TILES)):
                names = list(map(tuple, tiles[part].tolist()))
                corners = tiles[part, 1:] * width - texel
                view = _Scale(texel, texel / TEXEL_PIXELS)
                result[part] = self._painted(corners, view, self._below(names), names)
        return result

    def window(
        self, west: float, north: float, *, cell: tuple[float, float], columns: int, rows: int
    ) -> UInt8Array:
        """Return texels around the samples of a grid, as `terrain.appearance.Appearance.window` does.

        A texel is a pixel. Where layers filter what is below, it is taken for ground of a mean albedo.
        """
        view = _Scale(cell[0], cell[0])
        result = np.zeros((rows, columns, 4), np.uint8)
        if self.below is not None:
            result[:] = self.below.window(west, north, cell=cell, columns=columns, rows=rows)
        for top, left in product(range(0, rows, SIDE), range(0, columns, SIDE)):
            part = result[top : top + SIDE, left : left + SIDE]
            base = np.zeros((SIDE, SIDE, 4), np.uint8)
            base[: part.shape[0], : part.shape[1]] = part
            corner = west + (left - 0.5) * cell[0], north - (top + SIDE - 0.5) * cell[1]
            found = _without_filter(self._painted(np.array([corner]), view, [base], None)[0])
            part[:] = found[: part.shape[0], : part.shape[1]]
        return result

    def _below(self, names: Sequence[tuple[int, ...]]) -> list[UInt8Array | None]:
        """Return what lies below draped layers in tiles, None where nothing does."""
        if self.below is None:
            return [None] * len(names)
        missing = np.array([name for name in names if name not in self._bases], np.int64).reshape(-1, 3)
        found: dict[tuple[int, ...], UInt8Array | None] = dict.fromkeys(map(tuple, missing.tolist()))
        if len(full := missing[self.below.occupied(missing)]):
            found |= zip(map(tuple, full.tolist()), self.below.tiles(full), strict=True)
        bases = [found[name] if name in found else self._bases.get(name) for name in names]
        for name, base in found.items():
            self._bases.store(name, base)
        return bases

    def _painted(
        self,
        corners: Float64Array,
        view: _Scale,
        bases: Sequence[UInt8Array | None],
        names: Sequence[tuple[int, ...]] | None,
    ) -> UInt8Array:
        """Return squares of texels over bases, by their outermost corners (n, 2), m; tiles have names."""
        parts, pictures = self._parts(corners, view, names)
        styles = self._styles.rows(view)
        joined = *_joined(parts, styles, corners / view.texel), styles
        context, real, shape = self.context, self.context.real_dtype, (len(corners), SIDE, SIDE, 4)
        base_of = np.full(len(corners), -1, np.int32)
        some = [number for number, base in enumerate(bases) if base is not None]
        base_of[some] = np.arange(len(some))
        arrays = (
            *(each.astype(real) if each.dtype.kind == "f" else each for each in joined),
            *(base_of, np.array([bases[number] for number in some], np.uint8)),
            np.array(pictures, np.uint8),
        )
        buffers = [context.upload(array) for array in arrays]
        result, through = (context.empty(shape, np.uint8) for _ in range(2))
        given = *buffers, np.int32(len(styles)), np.int32(self.filters), result, through
        size = _BLOCKS * _BLOCK**2, _BLOCKS, len(corners)
        context.launch(_FILE, "drape", size, *given, group=(_BLOCK**2, 1, 1))
        found = context.download(result, shape, np.uint8)
        if not self.filters:
            return found
        return np.concatenate([found, context.download(through, shape, np.uint8)], axis=-1)

    def _parts(
        self, corners: Float64Array, view: _Scale, names: Sequence[tuple[int, ...]] | None
    ) -> tuple[list[_Part], list[UInt8Array]]:
        """Return the lists of layers in squares, from the lowest to the highest, and pictures."""
        parts, pictures = list[_Part](), list[UInt8Array]()
        rasters = dict(self.drapes.rasters(view.pixel))
        for tile, corner in enumerate(corners):
            lists = self._listed(corner, view, rasters, None if names is None else names[tile])
            for layer in range(len(self.drapes.layers)):
                if layer in lists:
                    parts.append(_Part(tile, int(self._styles.first[layer]), lists[layer]))
                elif layer in rasters:
                    west, north = float(corner[0]), float(corner[1]) + SIDE * view.texel
                    pixels = rasters[layer].pixels(west, north, view.texel, SIDE, SIDE)
                    if pixels[..., 3].any():
                        parts.append(_Part(tile, len(self.drapes.styles) + layer, len(pictures)))
                        pictures.append(np.concatenate([_ROOTS[pixels[..., :3]], pixels[..., 3:]], axis=-1))
        return parts, pictures

    def _listed(
        self, corner: Float64Array, view: _Scale, rasters: Container[int], name: tuple[int, ...] | None
    ) -> dict[int, _Lists]:
        """Return what is near a square, by the numbers of layers of vectors; that of tiles is kept."""
        drapes, styles = self.drapes, self._styles
        wanted = [
            number
            for number, (layer, source) in enumerate(zip(drapes.layers, drapes.sources, strict=True))
            if source and layer["visible"] and layer["opacity"] > 0.0 and number not in rasters
        ]
        found = {number: self._lists.get((name, self._layer_keys[number])) for number in wanted}
        if name is not None and all(each is not None for each in found.values()):
            return found
        box = (*corner.tolist(), *(corner + SIDE * view.texel).tolist())
        items = drapes.items(box, view.pixel)
        items = items._replace(points=(items.points - corner) / view.texel, along=items.along / view.texel)
        reach = (styles.reach * styles.units(view))[items.style]
        for number in wanted:
            own, first = items.layer == number, int(styles.first[number])
            is_mitred = styles.is_mitred[items.style[own]]
            lists = _lists_of(items.taken(own), reach[own], is_mitred, first)
            found[number] = lists._replace(pieces=lists.pieces.astype(self.context.real_dtype))
            if name is not None:
                self._lists.store((name, self._layer_keys[number]), found[number])
        return found

    @cached_property
    def _styles(self) -> _Styles:
        return _Styles(self.drapes.styles, self.drapes.layers)

    @cached_property
    def _layer_keys(self) -> tuple[Hashable, ...]:
        """What the lists of each layer depend on, besides the tile: no colours, opacities or order."""
        held, keys = self.drapes.held or (-1, -1), list[Hashable]()
        for number, layer in enumerate(self.drapes.layers):
            styles = [
                (each.shown, *(each.style[name] for name in ("width", "unit", "cap", "join")))
                for each in self.drapes.styles
                if each.layer == number
            ]
            values = layer["by"], layer["finest"], layer["coarsest"], *(each.value for each in layer.classes)
            edits = frozenset(layer.edits.items())
            keys.append((layer.source_key, edits, values, *styles, held[1] if held[0] == number else None))
        return tuple(keys)


def draped_appearance(terrain: Terrain) -> AppearanceSource:
    """Return what is painted on a terrain, with the draped layers of its sketch."""
    sketch = terrain.sketch
    if not sketch.drapes:
        return terrain.appearance
    from sketchterrain.drape.drapes import Drapes  # loads GDAL

    drapes = Drapes.open(sketch.drapes, sketch.frame, sketch.size, terrain.extent)
    return DrapedAppearance(drapes, terrain.context, terrain.extent, terrain.appearance)


class _Part(NamedTuple):
    """A layer in a square: lists of vectors, or the number of a picture."""

    tile: int
    style: int  # the first row of its styles
    lists: _Lists | int


def _joined(
    parts: Sequence[_Part], styles: Float64Array, corners: Float64Array
) -> tuple[Int32Array, Int32Array, Int32Array, FloatArray, Float64Array]:
    """Return starts, entries, numbers, pieces and anchors of a launch, for corners in texels."""
    every = np.arange(_BLOCKS**2, dtype=np.int32)
    blocks, entries, numbers = [every[:0]], [np.zeros((0, 4), np.int32)], [every[:0]]
    pieces, first_number, first_piece = [np.zeros((0, 8), np.float32)], 0, 0
    along, style = [np.zeros(0)], [every[:0]]
    for tile, row, lists in parts:
        if isinstance(lists, int):
            blocks.append(every + tile * _BLOCKS**2)
            own = np.array([row, _PICTURE, lists, 0], np.int32)
            entries.append(np.tile(own, (_BLOCKS**2, 1)))
            continue
        blocks.append(lists.block + np.int32(tile * _BLOCKS**2))
        entries.append(lists.entries + np.array([row, 0, first_number, 0], np.int32))
        numbers.append(lists.numbers + np.int32(first_piece))
        pieces.append(lists.pieces)
        along.append(lists.along)
        style.append(row + lists.style)
        first_number, first_piece = first_number + len(lists.numbers), first_piece + len(lists.pieces)
    period = styles[np.concatenate(style), _STYLE["style_dash_period"]]
    joined = np.concatenate(pieces)
    joined[:, _PIECE["drape_along"]] = np.mod(np.concatenate(along), np.where(period > 0.0, period, np.inf))
    block, rows = np.concatenate(blocks), np.concatenate(entries)
    opacity, fill = (styles[:, _STYLE[name]] for name in ("style_opacity", "style_fill_opacity"))
    shown = np.stack([opacity, fill, opacity + fill, opacity], axis=1) > 0.0  # STROKE, FILL, POINT, picture
    (order,) = np.nonzero(shown[rows[:, 0], rows[:, 1]])
    order = order[np.argsort(block[order], kind="stable")]
    starts = np.searchsorted(block[order], np.arange(len(corners) * _BLOCKS**2 + 1)).astype(np.int32)
    spacing, cosine, sine = (styles[:, _STYLE[f"style_hatch_{name}"]] for name in ("spacing", "x", "y"))
    anchors = np.zeros((0, 2))
    if spacing.any():
        x, y = corners[:, :1], corners[:, 1:]
        anchors = np.stack([x * cosine + y * sine, y * cosine - x * sine], axis=2)
        anchors = np.mod(anchors, np.where(spacing > 0.0, spacing, 1.0)[:, None])
    return starts, rows[order], np.concatenate(numbers), joined, anchors


def _lists_of(items: Items, reach: Float64Array, is_mitred: BoolArray, style: int) -> _Lists:
    """Return the lists of a layer's items near a square, in texels from its corner."""
    pieces, item, pairs = _pieces_of(items, reach, is_mitred)
    starts = np.ones(len(items.kind), np.bool_)  # of parts of a feature that are painted at once
    columns = [getattr(items, name) for name in ("feature", "kind", "style")]
    starts[1:] = np.any([each[1:] != each[:-1] for each in columns], axis=0)
    pairs = pairs[np.argsort(pairs[:, 0], kind="stable")]
    block, part = pairs[:, 0].astype(np.int32), np.cumsum(starts)[pairs[:, 1]]
    (first,) = np.nonzero(np.diff(block, prepend=-1) | np.diff(part, prepend=-1))
    classes, own, count = items.style - np.int32(style), pairs[first, 1], np.diff(first, append=len(pairs))
    entries = np.stack([classes[own], items.kind[own], first, count], axis=1).astype(np.int32)
    numbers = pairs[:, 2].copy()
    if not len(classes):
        return _Lists(pieces[:0], np.zeros(0), classes, block[first], entries, numbers)
    along = pieces[:, _PIECE["drape_along"]] + items.along[item]
    return _Lists(pieces, along, classes[item], block[first], entries, numbers)


def _row(**values: float) -> Float64Array:
    row = np.zeros(_FIRST_DASH + 16)
    for name, value in values.items():
        row[_STYLE[name]] = value
    return row


def _style_row(layer_style: LayerStyle) -> Float64Array:
    """Return a row of `DrapeStyle`, with lengths in the unit of its width."""
    style, opacity, width = layer_style.style, layer_style.opacity, layer_style.style["width"]
    spans = layer_style.dash_spans.ravel()
    angle, spacing = np.radians(style["hatch_angle"]), style["hatch_spacing"]
    row = _row(
        style_opacity=opacity if style["colour"] else 0.0,
        style_fill_opacity=opacity * style["fill_opacity"] if style["fill"] else 0.0,
        style_half_width=0.5 * width,
        style_cap=_CAPS.index(style["cap"]),
        style_join=_JOIN_NAMES.index(style["join"]),
        style_blend=BLENDS.index(layer_style.blend),
        style_hatch_x=-np.sin(angle),
        style_hatch_y=np.cos(angle),
        style_hatch_spacing=0.0 if style["hatch"] == "none" else spacing,
        style_hatch_duty=min(width / spacing, 1.0),
        style_hatch_cross=style["hatch"] == "cross",
        style_dash_period=layer_style.dashes.sum(),
        style_dash_pairs=len(spans) // 2,
        style_white=WHITE,
        style_layer=layer_style.layer,
        style_unlit=style["unlit"],
    )
    for first, colour in ((0, style["colour"]), (4, style["fill"])):
        row[first : first + 3] = linear_from_hex(colour) if colour else 0.0
    row[_FIRST_DASH : _FIRST_DASH + len(spans)] = spans
    return row


def _without_filter(texels: UInt8Array) -> UInt8Array:
    """Return texels (…, 4) that look over ground of a mean albedo as those with a filter (…, 8) do."""
    if texels.shape[-1] == 4:
        return texels
    values = texels / 255.0
    share = values[..., 3:4]
    own = values[..., :3] ** 2 * share + _UNKNOWN_GROUND * (values[..., 4:7] - (1.0 - share))
    root = np.sqrt(np.clip(own / np.maximum(share, 1e-6), 0.0, 1.0))
    return np.rint(255.0 * np.concatenate([root, share], axis=-1)).astype(np.uint8)


def _pieces_of(
    items: Items, reach: Float64Array, is_mitred: BoolArray
) -> tuple[Float64Array, Int32Array, Int32Array]:
    """Return pieces (m, 8), the item of each (m,), and (block, item, piece) by items, (p, 3)."""
    given = items.kind, items.first, items.points, items.ends, reach, is_mitred
    count = np.array([4, 64]) * (len(items.points) + 64)
    while True:
        most_pieces, most_pairs = count.tolist()
        pieces, item = np.empty((most_pieces, 8)), np.empty(most_pieces, np.int32)
        pairs = np.empty((most_pairs, 3), np.int32)
        host_function("drape_pieces")(*given, pieces, item, pairs, count, np.empty_like(items.points))
        if count[0] <= most_pieces and count[1] <= most_pairs:
            return pieces[: count[0]], item[: count[0]], pairs[: count[1]]
