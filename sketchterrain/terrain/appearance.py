"""Appearance tiles: colour of roads, land use and draped layers at any texel size, by one painter."""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import (
    BoolArray,
    Float32Array,
    Float64Array,
    Int32Array,
    LatticeArray,
    UInt8Array,
)
from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import BLENDS
from sketchterrain.features.items import Items
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.schema.colours import linear_from_hex
from sketchterrain.schema.styles import STYLE
from sketchterrain.terrain.orthophotos import ROOTS
from sketchterrain.terrain.orthophotos import WHITE as PICTURE_WHITE
from sketchterrain.terrain.painted_land import (
    BLOCK,
    BLOCKS,
    FILE,
    SIDE,
    PaintedLand,
    block_starts,
    lattice_corners,
)

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes, LayerStyle
    from sketchterrain.terrain.recipe import TerrainRecipe


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


_NOISE: Final = (60.0, 7.0, 0.7)  # m
_MAX_TILES: Final = 32  # in a launch
_EVERYWHERE: Final = np.array([[-np.inf, -np.inf, np.inf, np.inf]])


@dataclass(frozen=True, eq=False)
class Appearance:
    """Colour of what vectors and pictures paint on a terrain: draped layers over its roads and land use.

    A tile (level, column, row) covers [column, column + 1] × [row, row + 1] · extent / 2^level m and has
    `SIDE`² texels, row 0 northernmost; those of the outermost rows and columns are its neighbours'. It
    depends on its key alone.
    """

    land: PaintedLand
    layers: PaintedLayers | None = None

    def updated(self, recipe: TerrainRecipe, heights: Callable[..., Float32Array]) -> Appearance:
        """Return the appearance of a changed recipe; what depends on unchanged roads and areas is shared."""
        return replace(self, land=self.land.updated(recipe, heights))

    def with_drapes(self, drapes: Drapes, before: Appearance | None = None) -> Appearance:
        """Return it beneath draped layers; what is listed for unchanged ones of an earlier one is shared."""
        old = before and before.layers
        return replace(self, layers=replace(old, drapes=drapes) if old else PaintedLayers(drapes))

    @property
    def extent(self) -> float:
        """Width of the tile (0, 0, 0), m."""
        return self.land.extent

    @property
    def is_empty(self) -> bool:
        """Whether nothing is painted anywhere."""
        return self.land.is_empty and (self.layers is None or self.layers.drapes.is_empty)

    @property
    def filters(self) -> bool:
        """Whether a layer is unlit, or blends otherwise than by opacity: tiles have twice the channels."""
        return self.layers is not None and self.layers.filters

    @property
    def nbytes(self) -> int:
        """Bytes of lists that are kept."""
        return self.layers.nbytes if self.layers else 0

    def reach(self, old: Appearance) -> float:
        """Texels around `changed_areas` in which tiles may differ."""
        return max([1.0, *(each.layers.reach for each in (self, old) if each.layers)])

    def occupied(self, keys: npt.ArrayLike) -> BoolArray:
        """Return whether anything may be painted in tiles (n, 3) of level, column and row, (n,)."""
        tiles = np.asarray(keys, np.int64).reshape(-1, 3)
        found = self.land.occupied(tiles)
        if self.layers is None:
            return found
        width = self.extent / np.exp2(tiles[:, :1])
        margin = width / (SIDE - 2)
        boxes = np.hstack([tiles[:, 1:] * width - margin, (tiles[:, 1:] + 1) * width + margin])
        return found | self.layers.drapes.occupied(boxes)

    def changed_areas(self, old: Appearance) -> Float64Array:
        """Return boxes (n, 4), m, outside of which tiles of an earlier appearance are equal.

        Widths in px add `reach` texels.
        """
        boxes = [np.zeros((0, 4))] if self.land is old.land else [self.land.changed_areas(old.land)]
        if self.layers and old.layers:
            boxes.append(self.layers.drapes.changed_boxes(old.layers.drapes))
        elif self.layers or old.layers:
            return _EVERYWHERE
        return np.concatenate(boxes)

    def texel(self, level: int) -> float:
        """Return the side of a level's texels, m."""
        return float(self.extent / 2.0**level / (SIDE - 2))

    def tiles(self, keys: npt.ArrayLike) -> UInt8Array:
        """Return tiles.

        Parameters
        ----------
        keys : (n, 3) levels, columns and rows

        Returns
        -------
        (n, SIDE, SIDE, 4) uint8
            √ of the albedo of red, green and blue over what is painted, and the share of the texel that is.
            If the appearance `filters`, 8: how much of the ground's red, green and blue is seen, and what is
            lit.
        """
        tiles = np.asarray(keys, np.int64).reshape(-1, 3)
        result = np.zeros((len(tiles), SIDE, SIDE, 8 if self.filters else 4), np.uint8)
        for level in np.unique(tiles[:, 0]).tolist():
            own, texel = np.flatnonzero(tiles[:, 0] == level), self.texel(level)
            names = list(map(tuple, tiles[own].tolist()))
            scale = Scale(texel, texel / TEXEL_PIXELS)
            result[own] = self._squares(lattice_corners(tiles[own]), scale, names)
        return result

    def window(
        self, west: float, north: float, *, cell: tuple[float, float], columns: int, rows: int
    ) -> UInt8Array:
        """Return texels around the samples of a grid, (rows, columns, 4), as those of `tiles`.

        The first sample is at (west, north), m; the others follow every so many m to the east and the south,
        which differ by less than the number of rows can show. A texel is a pixel. Where layers filter what is
        below, it is taken for ground of a mean albedo.
        """
        inner, (east_step, south_step) = SIDE - 2, cell
        across, down = -(-columns // inner), -(-rows // inner)
        x = west - 0.5 * east_step + inner * east_step * np.arange(across)
        y = north + 0.5 * south_step - inner * south_step * np.arange(1, down + 1)
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        found = self._squares(to_lattice(places, self.extent), Scale(east_step, east_step))[:, 1:-1, 1:-1]
        whole = _without_filter(found).reshape(down, across, inner, inner, 4).swapaxes(1, 2)
        return whole.reshape(down * inner, across * inner, 4)[:rows, :columns]

    def _squares(
        self, corners: LatticeArray, scale: Scale, names: Sequence[Hashable] | None = None
    ) -> UInt8Array:
        """Return squares of texels, the outermost outside of south-west corners (n, 2), lattice units."""
        parts = [slice(first, first + _MAX_TILES) for first in range(0, len(corners), _MAX_TILES)]
        found = [self._launch(corners[part], scale, names[part] if names else None) for part in parts]
        return np.concatenate(found)

    def _launch(self, corners: LatticeArray, scale: Scale, names: Sequence[Hashable] | None) -> UInt8Array:
        land, unit, texel = self.land, metres_per_unit(self.extent), scale.texel
        context, real, shape = land.context, land.context.real_dtype, (len(corners), SIDE, SIDE, 4)
        starts, numbers, *vectors = land.launched(corners, texel)
        outer = corners * unit - texel
        layers = self.layers.launched(outer, scale, names) if self.layers else no_layers(len(corners))
        entry_starts, pieces, *parts = layers
        starts = np.column_stack([starts, entry_starts, np.full(len(starts), len(numbers))])
        arrays = corners, *vectors, starts.astype(np.int32), np.concatenate([numbers, pieces]), *parts
        place, *buffers = (
            context.upload(each.astype(real) if each.dtype.kind == "f" else each) for each in arrays
        )
        bits = np.array([max(round(np.log2(width / unit)), 0) for width in _NOISE] + [0], np.int32)
        result, base = context.empty(shape, np.uint8), land.base(corners, texel)
        through = context.empty(shape, np.uint8) if self.filters else result
        below = result if base is None else context.upload(base)
        context.launch(
            *(FILE, "appearance", (BLOCKS * BLOCK**2, BLOCKS, len(corners))),
            *(place, real.type(texel), real.type(unit), bits, *buffers, below, np.int32(base is not None)),
            *(np.int32(len(parts[-2])), np.int32(self.filters), result, through),
            group=(BLOCK**2, 1, 1),
        )
        found = [context.download(each, shape, np.uint8) for each in (result, through)[: 1 + self.filters]]
        return np.concatenate(found, axis=-1)


def _without_filter(texels: UInt8Array) -> UInt8Array:
    """Return texels (…, 4) that look over ground of a mean albedo as those with a filter (…, 8) do."""
    if texels.shape[-1] == 4:
        return texels
    values = texels / 255.0
    share = values[..., 3:4]
    own = values[..., :3] ** 2 * share + UNKNOWN_GROUND * (values[..., 4:7] - (1.0 - share))
    root = np.sqrt(np.clip(own / np.maximum(share, 1e-6), 0.0, 1.0))
    return np.rint(255.0 * np.concatenate([root, share], axis=-1)).astype(np.uint8)
