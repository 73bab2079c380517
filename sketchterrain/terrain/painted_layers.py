"""Draped layers as appearance tiles paint them: parts of features, listed by blocks of texels; pictures."""

from __future__ import annotations

from collections.abc import Container, Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int32Array, UInt8Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import BLENDS
from sketchterrain.features.items import Items
from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.schema.colours import linear_from_hex
from sketchterrain.schema.styles import STYLE
from sketchterrain.terrain.orthophotos import ROOTS
from sketchterrain.terrain.orthophotos import WHITE as PICTURE_WHITE
from sketchterrain.terrain.painted_land import BLOCKS, FILE, SIDE, block_starts

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes, LayerStyle

WHITE: Final = 0.8
"""Albedo of white in styles: that of paper, so that colours keep below what sunlit ground can reflect."""
TEXEL_PIXELS: Final = 1.1 * 0.5**0.5
"""Pixels of a texel, for widths in px: the geometric mean of the 0.55 … 1.1 px at which tiles are drawn."""
UNKNOWN_GROUND: Final = 0.2
"""Albedo below layers that filter it, where a picture has no ground."""
_STYLE: Final = kernel_columns("drape.clh", "DrapeStyle")
_ROOTS: Final = np.rint(255.0 * ROOTS).astype(np.uint8)  # of the albedo of pixels, 255 for white
(_PICTURE,) = (int(each) for each in kernel_constants(FILE, "ENTRY_PICTURE"))
_CAPS, _JOIN_NAMES = (STYLE[name].choices for name in ("cap", "join"))
_ALONG: Final = kernel_columns("drape.clh", "DrapePiece")["drape_along"]
_FIRST_DASH, _COLUMNS = 24, 40
_LENGTHS: Final = [
    *(_STYLE[f"style_{name}"] for name in ("half_width", "hatch_spacing", "dash_period")),
    *range(_FIRST_DASH, _COLUMNS),
]
_ITEMS: Final = 10 << 20  # bytes in memory


class Scale(NamedTuple):
    """Metres of a texel and of a pixel."""

    texel: float
    pixel: float


@dataclass(frozen=True, eq=False)
class PaintedLayers:
    """Draped layers. Widths in px are right in the mean of the scales at which a tile is drawn.

    What is near tiles of unchanged layers is shared between versions.
    """

    drapes: Drapes
    _known: LRUCache = field(default_factory=partial(LRUCache, max_bytes=_ITEMS), repr=False)

    @cached_property
    def filters(self) -> bool:
        """Whether a layer is unlit, or blends otherwise than by opacity."""
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
        """Bytes of features near tiles that are kept."""
        return self._known.nbytes

    def launched(
        self, corners: npt.NDArray[np.floating[Any]], scale: Scale, names: Sequence[Hashable] | None
    ) -> tuple[npt.NDArray[Any], ...]:
        """Return starts, numbers, entries, pieces, anchors, styles and pictures for squares.

        Corners (n, 2), m, are those of the outermost texels; tiles have names.
        """
        drapes, rows = self.drapes, self._rows.copy()
        units = np.where(rows[:, _STYLE["style_in_pixels"]] > 0.0, scale.pixel, 1.0) / scale.texel
        rows[:, _LENGTHS] *= units[:, None]
        lists, pictures = _Lists(rows), list[UInt8Array]()
        rasters = dict(drapes.rasters(scale.pixel))
        for tile, corner in enumerate(corners):
            lists.add(tile, self._items(corner, scale, rasters, names[tile] if names else None))
            for number, source in rasters.items():
                west, north = float(corner[0]), float(corner[1]) + SIDE * scale.texel
                pixels = source.pixels(west, north, scale.texel, SIDE, SIDE)
                if pixels[..., 3].any():
                    lists.add_picture(tile, len(drapes.styles) + number, len(pictures))
                    pictures.append(np.concatenate([_ROOTS[pixels[..., :3]], pixels[..., 3:]], axis=-1))
        spacing, cosine, sine = (rows[:, _STYLE[f"style_hatch_{name}"]] for name in ("spacing", "x", "y"))
        x, y = np.hsplit(corners / scale.texel, 2)
        anchors = np.stack([x * cosine + y * sine, y * cosine - x * sine], axis=2)
        anchors = np.mod(anchors, np.where(spacing > 0.0, spacing, 1.0)[:, None])
        return *lists.joined(len(corners)), anchors, rows, np.array(pictures, np.uint8)

    def _items(
        self, corner: Float64Array, scale: Scale, rasters: Container[int], name: Hashable | None
    ) -> Items:
        """Return what is near a square, in texels from its corner; that of tiles is kept by layers."""
        drapes = self.drapes
        wanted = [
            number
            for number, (layer, source) in enumerate(zip(drapes.layers, drapes.sources, strict=True))
            if source and layer["visible"] and layer["opacity"] > 0.0 and number not in rasters
        ]
        found = {number: self._known.get((name, self._layer_keys[number])) for number in wanted}
        if name is None or any(each is None for each in found.values()):
            box = (*corner.tolist(), *(corner + SIDE * scale.texel).tolist())
            items = drapes.items(box, scale.pixel)
            points, along = (items.points - corner) / scale.texel, items.along / scale.texel
            items = items._replace(points=points, along=along)
            for number in wanted:
                own = items.taken(items.layer == number)
                found[number] = own = own._replace(style=own.style - self._first[number])
                if name is not None:
                    self._known.store((name, self._layer_keys[number]), own)
        return Items.joined(
            [each._replace(style=each.style + self._first[number]) for number, each in found.items()]
        )

    @cached_property
    def _rows(self) -> Float64Array:
        """Rows of `DrapeStyle` of classes, then of each layer as a raster, with lengths in their units."""
        rows = [style_row(each) for each in self.drapes.styles]
        for number, layer in enumerate(self.drapes.layers):
            look = {"style_opacity": layer["opacity"], "style_blend": BLENDS.index(layer["blend"])}
            rows.append(_row(**look, style_white=PICTURE_WHITE, style_layer=number))
        return np.array(rows, np.float64).reshape(-1, _COLUMNS)

    @cached_property
    def _first(self) -> npt.NDArray[np.int32]:
        """The first row of each layer."""
        layers = np.array([each.layer for each in self.drapes.styles], np.int64)
        return np.searchsorted(layers, np.arange(len(self.drapes.layers))).astype(np.int32)

    @cached_property
    def _layer_keys(self) -> tuple[Hashable, ...]:
        """What is near a tile of each layer depends on, besides it: no colours, opacities or order."""
        held, keys = self.drapes.held or (-1, -1), list[Hashable]()
        for number, layer in enumerate(self.drapes.layers):
            styles = [
                (each.shown, *(each.style[name] for name in ("width", "unit", "join")))
                for each in self.drapes.styles
                if each.layer == number
            ]
            values = layer["by"], layer["finest"], layer["coarsest"], *(each.value for each in layer.classes)
            edits = frozenset(layer.edits.items())
            keys.append((layer.source_key, edits, values, *styles, held[1] if held[0] == number else None))
        return tuple(keys)


class _Lists:
    """Entries of a launch, by blocks, with rows of `DrapeStyle` whose lengths are in texels."""

    def __init__(self, rows: Float64Array) -> None:
        self._rows = rows
        square = rows[:, _STYLE["style_cap"]] == _CAPS.index("square")
        self._reach = rows[:, _STYLE["style_half_width"]] * np.where(square, np.sqrt(2.0), 1.0)
        self._is_mitred = rows[:, _STYLE["style_join"]] == _JOIN_NAMES.index("mitre")
        none = np.zeros(0, np.int32)
        self._parts: list[tuple[npt.NDArray[Any], ...]] = [
            (none, np.zeros((0, 4), np.int32), none, np.zeros((0, 8)))
        ]
        self._listed = self._pieces = 0

    def add(self, square: int, items: Items) -> None:
        """Add the items near a square, in texels from its corner."""
        rows, style = self._rows, items.style
        if not len(style):
            return
        pieces, item, pairs = _pieces_of(items, self._reach[style], self._is_mitred[style])
        starts = np.ones(len(style), np.bool_)  # of parts of a feature that are painted at once
        columns = items.feature, items.kind, style
        starts[1:] = np.any([each[1:] != each[:-1] for each in columns], axis=0)
        pairs = pairs[np.argsort(pairs[:, 0], kind="stable")]
        block, part = pairs[:, 0], np.cumsum(starts)[pairs[:, 1]]
        (first,) = np.nonzero(np.diff(block, prepend=-1) | np.diff(part, prepend=-1))
        own, count = pairs[first, 1], np.diff(first, append=len(pairs))
        entries = np.stack([style[own], items.kind[own], first + self._listed, count], axis=1)
        period = rows[style[item], _STYLE["style_dash_period"]]
        along = pieces[:, _ALONG] + items.along[item]
        pieces[:, _ALONG] = np.mod(along, np.where(period > 0.0, period, np.inf))
        numbers, blocks = pairs[:, 2] + self._pieces, block[first] + square * BLOCKS**2
        self._parts.append((blocks, entries, numbers, pieces))
        self._listed, self._pieces = self._listed + len(numbers), self._pieces + len(pieces)

    def add_picture(self, square: int, style: int, number: int) -> None:
        """Add a picture that a square is filled with."""
        blocks, entry = np.arange(BLOCKS**2) + square * BLOCKS**2, [style, _PICTURE, number, 0]
        self._parts.append((blocks, np.tile(entry, (BLOCKS**2, 1)), *self._parts[0][2:]))

    def joined(self, squares: int) -> tuple[npt.NDArray[Any], ...]:
        """Return starts of blocks, numbers, entries from the lowest to the highest layer, and pieces."""
        block, entries, numbers, pieces = map(np.concatenate, zip(*self._parts, strict=True))
        opacity, fill = (self._rows[:, _STYLE[name]] for name in ("style_opacity", "style_fill_opacity"))
        # Of strokes, fills, points and pictures.
        shown = np.stack([opacity, fill, opacity + fill, opacity], axis=1) > 0.0
        (order,) = np.nonzero(shown[entries[:, 0], entries[:, 1]])
        layer = self._rows[entries[order, 0], _STYLE["style_layer"]]
        order = order[np.lexsort((layer, block[order]))]
        starts = block_starts(block[order], squares)
        return starts, numbers.astype(np.int32), entries[order].astype(np.int32), pieces


def no_layers(squares: int) -> tuple[npt.NDArray[Any], ...]:
    """Return what `PaintedLayers.launched` returns without any layer."""
    rows = np.zeros((0, _COLUMNS))
    return *_Lists(rows).joined(squares), np.zeros((squares, 0, 2)), rows, np.zeros(0, np.uint8)


def _row(**values: float) -> Float64Array:
    row = np.zeros(_COLUMNS)
    for name, value in values.items():
        row[_STYLE[name]] = value
    return row


def style_row(layer_style: LayerStyle) -> Float64Array:
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
        style_in_pixels=style["unit"] == "px",
    )
    for first, colour in ((0, style["colour"]), (4, style["fill"])):
        row[first : first + 3] = linear_from_hex(colour) if colour else 0.0
    row[_FIRST_DASH : _FIRST_DASH + len(spans)] = spans
    return row


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
