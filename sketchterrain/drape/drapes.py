"""All draped layers of a sketch: what is drawn near a place, and what is under it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, Int64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import DrapedLayer, drape_problem
from sketchterrain.drape.raster_source import DrapedRaster
from sketchterrain.drape.vector_source import VectorSource
from sketchterrain.drape.vector_store import FARTHEST
from sketchterrain.errors import InputError, did_you_mean, first_few, format_value, one_line
from sketchterrain.features.files import find_driver
from sketchterrain.features.items import FILL, Items
from sketchterrain.features.levels import Level, level_of
from sketchterrain.features.picking import PICK
from sketchterrain.features.table import FeatureTable
from sketchterrain.host.library import host_function
from sketchterrain.schema.parameters import Properties

BUDGET: Final = 24 << 20
"""The most bytes of memory of all sources and their caches."""

_MITRE: Final = 2.0  # widths from a line that its corners reach
_ORDER: Final = np.array([1, 0, 2])  # of strokes, fills and points of one feature
_TILE: Final = 128.0  # texels of the smallest tile, for widths in pixels
_MAX_NAMES: Final = 12  # in a note
_NO_PAINT: Final = {"title", "label", "label_size", "label_colour", "sha256"}

Source = VectorSource | DrapedRaster


class Pick(NamedTuple):
    """What is at a place."""

    layer: int  # number of the layer
    feature: int  # its id; -1 of a raster
    distance: float = 0.0  # m from what is drawn


@dataclass(frozen=True)
class LayerStyle:
    """How a class of features of a layer looks."""

    layer: int  # number of the layer
    style: Properties  # by the names in `STYLE`
    opacity: float  # of the layer
    blend: str  # of the layer

    def width(self, texel: float) -> float:
        """Return the width (m) of lines where a pixel is `texel` m."""
        return float(self.style["width"]) * (1.0 if self.style["unit"] == "m" else texel)

    def reach(self, texel: float) -> float:
        """Return how far (m) it paints beyond lines and points."""
        return self.width(texel) * (_MITRE if self.style["join"] == "mitre" else 1.0)

    @property
    def of_casing(self) -> LayerStyle:
        """The style of what is drawn beneath all lines of a layer: wider ones, if it has a casing."""
        style = {**self.style, "colour": self.style["casing"], "fill": "", "dash": ""}
        wider = style["width"] + 2.0 * style["casing_width"]
        style["width"] = wider if style["casing"] and style["width"] > 0.0 else 0.0
        return replace(self, style=style)

    @property
    def dashes(self) -> Float64Array:
        """Lengths of dashes and gaps in turn, an even number, in the unit of its width; empty if solid."""
        lengths = np.array([float(each) for each in self.style["dash"].split()])
        return np.tile(lengths, 1 + len(lengths) % 2) if lengths.any() else lengths[:0]

    @property
    def dash_spans(self) -> Float64Array:
        """Start and length of each dash of a period, (n, 2)."""
        lengths = self.dashes
        return np.stack([np.cumsum(lengths) - lengths, lengths], axis=1)[::2]

    @property
    def shown(self) -> tuple[bool, bool, bool]:
        """Whether strokes, fills and points are drawn."""
        lines = bool(self.style["colour"]) and self.style["width"] > 0.0
        return lines, bool(self.style["fill"]) and self.style["fill_opacity"] > 0.0, lines


@dataclass(frozen=True, eq=False)
class Drapes:
    """Draped layers, the lowest first, with their sources, which versions share."""

    layers: tuple[DrapedLayer, ...]
    sources: tuple[Source | None, ...]  # None: it cannot be read
    problems: tuple[str, ...]  # a line for each layer that cannot be read or whose file has changed
    frame: Mapping[str, Any]
    size: tuple[float, float]  # m
    extent: float  # m
    held: tuple[int, int] | None = None  # layer and feature that are left out
    memory: LRUCache = field(default_factory=lambda: LRUCache(max_bytes=BUDGET - (BUDGET >> 2)), repr=False)

    @classmethod
    def open(
        cls, layers: Sequence[DrapedLayer], frame: Mapping[str, Any], size: tuple[float, float], extent: float
    ) -> Drapes:
        """Open the sources of layers in a sketch's frame; `problems` names those that cannot be read."""
        return cls((), (), (), frame, size, extent).updated(layers)

    def updated(self, layers: Sequence[DrapedLayer]) -> Drapes:
        """Return the drapes of other layers, with the open sources of those that have the same."""
        known = {
            layer.source_key: each for layer, each in zip(self.layers, self.sources, strict=True) if each
        }
        sources, problems = list[Source | None](), list[str]()
        for layer in layers:
            source = known.get(layer.source_key)
            try:
                source = (source or self._source(layer)).updated(layer)
                if problem := source.problem(layer):
                    problems.append(problem)
            except InputError as error:
                problems.append(str(error))
            sources.append(source)
        return replace(
            self, layers=tuple(layers), sources=tuple(sources), problems=tuple(problems), held=None
        )

    def _source(self, layer: DrapedLayer) -> Source:
        if problem := drape_problem(layer.replace(sha256="")):
            raise InputError(problem)
        if (path := Path(layer.path)).is_dir():
            raise InputError(f"draped layer {one_line(path)}: expected a file, not a folder")
        if find_driver(path, f"draped layer {one_line(path)}"):
            return VectorSource.open(layer, self.frame, self.extent)
        return DrapedRaster(layer, self.frame, self.size, self.memory)

    def without(self, held: tuple[int, int] | None) -> Drapes:
        """Return the drapes without one feature, by its layer and id."""
        return self if held == self.held else replace(self, held=held)

    @cached_property
    def styles(self) -> tuple[LayerStyle, ...]:
        """Styles by layer: that of features without a class, those of its classes, then those of casings."""
        styles = list[LayerStyle]()
        for number, layer in enumerate(self.layers):
            rows = map(layer.style_of, range(-1, len(layer.classes)))
            own = [LayerStyle(number, each, layer["opacity"], layer["blend"]) for each in rows]
            styles += [*own, *(each.of_casing for each in own)]
        return tuple(styles)

    @cached_property
    def _first_style(self) -> list[int]:
        return list(accumulate((2 + 2 * len(layer.classes) for layer in self.layers), initial=0))

    @cached_property
    def _widths(self) -> Float64Array:
        """(n, 2) width of each style in metres and in pixels, of which one is 0."""
        return np.array([(each.width(0.0), each.width(1.0) - each.width(0.0)) for each in self.styles])

    @cached_property
    def _shown(self) -> BoolArray:
        """(n, 3) whether strokes, fills and points of each style are drawn."""
        return np.array([each.shown for each in self.styles])

    def _styles_of(self, layer: int) -> tuple[LayerStyle, ...]:
        return self.styles[self._first_style[layer] : self._first_style[layer + 1]]

    @property
    def is_empty(self) -> bool:
        """Whether nothing is visible at any scale."""
        return not any(self._is_visible(number) for number in range(len(self.layers)))

    @property
    def nbytes(self) -> int:
        """Bytes in memory of sources and their caches."""
        edits = sum(source.nbytes for source in self.sources if isinstance(source, VectorSource))
        return self.memory.nbytes + edits

    def _is_visible(self, number: int, texel: float | None = None) -> bool:
        layer = self.layers[number]
        if self.sources[number] is None or not layer["visible"] or layer["opacity"] <= 0.0:
            return False
        return texel is None or bool(layer["finest"] <= texel and not 0.0 < layer["coarsest"] <= texel)

    @property
    def shown_box(self) -> Bounds | None:
        """The box (m) of all visible layers inside the sketch, None without any."""
        boxes = [each.box for number, each in enumerate(self.sources) if each and self._is_visible(number)]
        if not boxes:
            return None
        low = np.maximum(np.fmin.reduce(boxes)[:2], 0.0)
        high = np.minimum(np.fmax.reduce(boxes)[2:], self.size)
        return (*low.tolist(), *high.tolist()) if (low <= high).all() else None

    @property
    def notes(self) -> tuple[str, ...]:
        """A line for each layer that is not near the sketch, or has features that are not."""
        notes, (east, north) = list[str](), self.size
        for layer, source in zip(self.layers, self.sources, strict=True):
            if isinstance(source, VectorSource):
                notes += [f"{layer.title}: {note}" for note in _store_notes(layer, source)]
            if isinstance(source, VectorSource) and source.facts["left_out"]:
                reason = f"they lie farther than {FARTHEST:g} times the extent, or cannot be projected"
                notes.append(f"{layer.title}: {source.facts['left_out']} features left out: {reason}")
            elif source is not None and not _near(source.box[None], (0.0, 0.0, east, north), 0.0)[0]:
                notes.append(f"{layer.title}: nothing of it lies in the sketch")
        return tuple(notes)

    def items(self, box: Bounds, texel: float) -> Items:
        """Return the visible parts of features near a box (m), each within its own reach of it.

        They are within a quarter of `texel`, metres a pixel, of the features.
        """
        return Items.joined([self._within(box, *vectors, texel) for vectors in self._vectors(texel)])

    def _within(self, box: Bounds, number: int, source: VectorSource, texel: float) -> Items:
        """Return the visible items of a layer near a box (m)."""
        levels = source.query(_grown(box, self._reach(number, texel)), texel)
        return self._drawn(number, source, texel, levels, box)

    def only(self, held: tuple[int, int], texel: float) -> Items:
        """Return the visible parts of one feature, by its layer and id, with all of its vertices."""
        number, feature = held
        if (source := dict(self._vectors(texel)).get(number)) is None:
            return Items.empty()
        level = level_of(source.parts(feature), 0.0)
        return self.without(None)._drawn(number, source, texel, [(level, np.arange(len(level.items)))], None)

    def _vectors(self, texel: float) -> Iterator[tuple[int, VectorSource]]:
        for number, source in enumerate(self.sources):
            if isinstance(source, VectorSource) and self._is_visible(number, texel):
                yield number, source

    def _drawn(
        self,
        number: int,
        source: VectorSource,
        texel: float,
        levels: Sequence[tuple[Level, Int64Array]],
        box: Bounds | None,
    ) -> Items:
        """Return the visible items of a layer, in their order, that reach a box."""
        styles, shown = self._styles_of(number), self._shown[self._first_style[number] :]
        reach = np.array([each.reach(texel) for each in styles])
        found = []
        half = len(styles) // 2
        for level, which in levels:
            items = level.items[which]
            row = 1 + source.classes(items["feature"], self.layers[number], self.memory)
            if shown[half : 2 * half].any():
                items, row = np.concatenate([items, items]), np.append(row + half, row)
            keep = shown[row, items["kind"]]
            if box is not None:
                keep &= _near(items["box"], box, reach[row])
            if self.held is not None and self.held[0] == number:
                keep &= items["feature"] != self.held[1]
            items, row = items[keep], row[keep]
            order = np.lexsort((_ORDER[items["kind"]], items["feature"], row < half))
            items = items[order]
            found.append(
                Items(
                    items["feature"].astype(np.int64),
                    np.full(len(items), number, np.int32),
                    (self._first_style[number] + row[order]).astype(np.int32),
                    items["kind"].copy(),
                    np.append(0, np.cumsum(items["count"], dtype=np.int64)),
                    level.vertices(items),
                    items["along"].copy(),
                    items["ends"].copy(),
                )
            )
        joined = Items.joined(found)
        if len(found) == 1 or not len(found[1].feature):
            return joined
        is_line = joined.style < self._first_style[number] + half
        return joined.taken(np.lexsort((_ORDER[joined.kind], joined.feature, is_line)))

    def rasters(self, texel: float) -> list[tuple[int, DrapedRaster]]:
        """Return the visible rasters, the lowest first, with the numbers of their layers."""
        return [
            (number, source)
            for number, source in enumerate(self.sources)
            if isinstance(source, DrapedRaster) and self._is_visible(number, texel)
        ]

    def occupied(self, boxes: Float64Array) -> BoolArray:
        """Return whether anything visible may lie in boxes (n, 4), m, of at least 128 pixels."""
        found = np.zeros(len(boxes), bool)
        texel = float(np.ptp(boxes.reshape(-1, 2, 2), axis=1).max(initial=0.0)) / _TILE
        for number, source in enumerate(self.sources):
            if source is not None and self._is_visible(number):
                reach = self._reach(number, texel)
                for each in np.flatnonzero(~found & _near(boxes, source.box, reach)):
                    found[each] = source.occupies(_grown(boxes[each], reach))
        return found

    def _reach(self, number: int, texel: float) -> float:
        """Return how far (m) a layer paints beyond its features or pixels, for texels (m)."""
        if isinstance(self.sources[number], DrapedRaster):
            return texel
        return max(each.reach(texel) for each in self._styles_of(number))

    def changed_boxes(self, old: Drapes) -> Float64Array:
        """Return boxes (n, 4), m, outside of which features and pixels are those of another version.

        They have widths in metres; those in pixels are beside them.
        """
        boxes, left_out = [np.zeros((0, 4))], self.held if self.held == old.held else None
        for number in range(max(len(self.layers), len(old.layers))):
            looks = self._look(number), old._look(number)
            new, before = (
                each.sources[number] if look else None for each, look in zip((self, old), looks, strict=True)
            )
            is_same = new is before
            if (
                isinstance(new, VectorSource)
                and isinstance(before, VectorSource)
                and new.facts is before.facts
            ):
                without = left_out[1] if left_out and left_out[0] == number else None
                boxes.append(self._widened(number, new.changed_boxes(before, without=without)))
                is_same = True
            if not is_same or looks[0] != looks[1]:
                pairs = (self, new), (old, before)
                boxes += [each._widened(number, source.box[None]) for each, source in pairs if source]
        for each in (self, old) if self.held != old.held else ():
            if each.held and isinstance(source := each.sources[each.held[0]], VectorSource):
                boxes.append(each._widened(each.held[0], source.box_of(each.held[1])[None]))
        found = np.concatenate(boxes)
        return np.asarray(found[np.isfinite(found).all(axis=1)])

    def _look(self, number: int) -> tuple[object, ...] | None:
        """Return what a layer's picture depends on besides its source; None if it is not visible."""
        if number >= len(self.layers) or not self._is_visible(number):
            return None
        layer = self.layers[number]
        values = {**layer.values, **layer.style}
        return tuple(value for name, value in values.items() if name not in _NO_PAINT), layer.classes

    def _widened(self, number: int, boxes: Float64Array) -> Float64Array:
        reach = self._reach(number, 0.0)
        return np.asarray(boxes + np.array([-reach, -reach, reach, reach]))

    def picks(self, x: float, y: float, texel: float) -> list[Pick]:
        """Return what is drawn at a place (m), the topmost first, then what is within 3 px, nearest first.

        A raster hides what is below it. Areas are found inside only, lines along gaps of their dashes too.
        """
        drawn, near = list[Pick](), dict[tuple[int, int], float]()
        for number in reversed(range(len(self.layers))):
            source = self.sources[number]
            if not self._is_visible(number, texel):
                continue
            if isinstance(source, DrapedRaster):
                if source.pixels(x - 0.5 * texel, y + 0.5 * texel, texel, 1, 1)[0, 0, 3]:
                    drawn.append(Pick(number, -1))
                    break
            elif source is not None:
                gaps = self._gaps(number, source, x, y, texel)
                bodies = sorted(
                    ((gap == -np.inf, each) for each, gap in gaps.items() if gap <= 0.0), reverse=True
                )
                drawn += [Pick(number, each) for _, each in bodies]
                near |= {(number, each): gap for each, gap in gaps.items() if gap > 0.0}
        return drawn + [Pick(*key, near[key]) for key in sorted(near, key=near.__getitem__)]

    def _gaps(self, number: int, source: VectorSource, x: float, y: float, texel: float) -> dict[int, float]:
        """Return how far (m) a place is from features within 3 px of it as they are drawn.

        It is at most 0 on casings, which are beneath all else of the layer, and -inf on the rest.
        """
        found, turns, most = dict[int, float](), Counter[int](), PICK * texel
        own = slice(*self._first_style[number : number + 2])
        widths, shown = 0.5 * np.maximum(self._widths[own] @ (1.0, texel), texel), self._shown[own]
        half = widths[: len(widths) // 2]
        cased = np.maximum(half, widths[len(half) :])
        for level, which in source.query(_grown((x, y, x, y), float(cased.max()) + most), texel):
            items = level.items[which]
            row = 1 + source.classes(items["feature"], self.layers[number], self.memory)
            keep = shown[row, items["kind"]]
            items, row = items[keep], row[keep]
            if not len(items):
                continue
            distance, turned = np.empty(len(items)), np.empty(len(items), np.int64)
            lines = items["first"].copy(), items["count"].copy(), level.points
            host_function("lines_around")(*lines, x, y, distance, turned)
            gap = np.where(distance <= half[row], -np.inf, distance - cased[row])
            is_area = items["kind"] == FILL
            chosen = np.flatnonzero(np.where(is_area, turned != 0, gap <= most))
            columns = items["feature"], is_area, gap, turned
            for each, area, near, turn in zip(*(column[chosen].tolist() for column in columns), strict=True):
                if area:
                    turns[each] += turn
                else:
                    found[each] = min(found.get(each, near), near)
        return found | {each: -np.inf for each, turn in turns.items() if turn}

    def pick(self, x: float, y: float, texel: float) -> Pick | None:
        """Return the first of `picks`."""
        return next(iter(self.picks(x, y, texel)), None)

    def features(self, layer: int, box: Bounds) -> Int64Array:
        """Return the ids of a layer's features near a box (m), ascending."""
        source = self.sources[layer]
        return source.table.touching(box) if isinstance(source, VectorSource) else np.zeros(0, np.int64)

    def table(self, layer: int) -> FeatureTable:
        """Return the features of a layer by its number; raise InputError if it is no vector layer."""
        source = self.sources[layer] if 0 <= layer < len(self.sources) else None
        if not isinstance(source, VectorSource):
            raise InputError(f"draped layer {layer}: expected features")
        return source.table


def _store_notes(layer: DrapedLayer, source: VectorSource) -> Iterator[str]:
    """Yield what of a layer's file is not shown."""
    facts = source.facts
    if not layer["table"] and len(facts["tables"]) > 1:
        shown, *others = map(format_value, facts["tables"])
        yield f"of its tables {shown} is shown; table= selects another: {first_few(others, _MAX_NAMES)}"
    if facts["empty"]:
        yield f"{facts['empty']} of {facts['features']} features have no geometry, or are damaged"
    if ids := list(map(str, facts["incomplete"])):
        yield f"areas with missing ways are absent or wrong: relations {first_few(ids, _MAX_NAMES)}"
    names = source.table.columns.keys() | {
        name for edit in layer.edits.values() if edit for name in edit.properties
    }
    styles = [layer.style_of(number) for number in range(-1, len(layer.classes))]
    for key, value in {("by", layer["by"]), *(("label", str(style["label"])) for style in styles)}:
        if value and value not in names:
            known = f"expected {first_few(sorted(names), _MAX_NAMES)}" if names else "it has none"
            yield f"no property {key} = {format_value(value)}: {known}{did_you_mean(value, names)}"


def _grown(box: Any, by: float) -> Bounds:
    west, south, east, north = map(float, box)
    return west - by, south - by, east + by, north + by


def _near(boxes: npt.NDArray[Any], box: Any, reach: Any) -> BoolArray:
    """Return which boxes (n, 4) are within a distance of another."""
    west, south, east, north = box
    across = np.maximum(boxes[:, 0] - east, west - boxes[:, 2])
    along = np.maximum(boxes[:, 1] - north, south - boxes[:, 3])
    return np.asarray(np.maximum(across, along) <= reach)
