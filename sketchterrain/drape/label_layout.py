"""Labels of draped features: their anchors on the ground, and the choice of those that a picture shows."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array, StructuredArray
from sketchterrain.document.drapes import class_value
from sketchterrain.errors import one_line
from sketchterrain.host.library import host_function

if TYPE_CHECKING:
    from sketchterrain.document.drapes import DrapedLayer
    from sketchterrain.drape.drapes import Drapes

MOST_SHOWN: Final = 200  # labels at once
MOST_FEATURES: Final = 10_000  # features around the eye that may be labelled, the nearest ones
LONGEST: Final = 48  # letters; longer texts are elided
FADE: Final = 0.3  # s
MARGIN: Final = 6.0  # px between a label that appears and others; those that are shown may touch
REPEAT: Final = 300.0  # px between labels of a line, half of it once they are shown
GAP: Final = 4.0  # px between a line or symbol and its label
NEW: Final = 8  # labels that may appear in a frame: their letters are drawn then
SPACING: Final = 500.0  # m between anchors along a line, at least
_LEVELS: Final = 6  # of anchors along a line: 1/2; 1/4 and 3/4; …
_ID_BITS: Final = 44
_LOWEST: Final = 32.0  # m above the ground, from which on cells widen
_NEAREST: Final = 4.0  # half width of the first square of features, in cells of `LabelCandidates.update`

ANCHOR: Final = np.dtype(
    [
        ("feature", "i8"),  # number of its layer · 2⁴⁴ + its id
        ("label", "i8"),  # number of its `Label`
        ("weight", "f8"),  # length of a line, side of an area (m)
        ("place", "f8", 3),  # m
        ("size", "f4", 2),  # px
        ("rise", "f4"),  # px from the place to the label's lower side
        ("seen", "?"),  # not behind terrain
        ("steady", "f4"),  # −1 … 1: a label may appear at 1, and disappears at 0
        ("shown", "?"),
        ("waits", "?"),  # to be shown by one of the next frames
        ("opacity", "f4"),
    ]
)
"""An anchor of a label; arrays are sorted by priority."""


def layer_numbers(rows: StructuredArray) -> Int64Array:
    """Return the numbers of the layers of anchors."""
    return np.asarray(rows["feature"] >> _ID_BITS)


class Label(NamedTuple):
    """Text of a feature, and the number of its class."""

    text: str
    style: int


def label_text(value: object) -> str:
    """Return the text of a property on one line, elided; empty for None and values that are not finite."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    text = f"{value:.15g}" if isinstance(value, float) else str(value)
    text = one_line(" ".join(text.split()))
    return text if len(text) <= LONGEST else text[: LONGEST - 1].rstrip() + "…"


def anchors(geometry: Any) -> tuple[Float64Array, float]:
    """Return places (k, 2; m) of a feature's labels, the most important first, and its weight (m).

    An area has one inside of its largest part, a line has them at 1/2, 1/4, 3/4, … of its longest part.
    """
    parts = shapely.get_parts([] if geometry is None else [geometry])
    parts = parts[~shapely.is_empty(parts)]
    dimension = shapely.get_dimensions(parts)
    parts = parts[dimension == dimension.max(initial=0)]
    if dimension.max(initial=0) == 0:
        return shapely.get_coordinates(parts), 0.0
    size = np.sqrt(shapely.area(parts)) if dimension.max() == 2 else shapely.length(parts)
    largest = parts[np.argmax(size)]
    if dimension.max() == 2:
        return shapely.get_coordinates(shapely.point_on_surface(largest)), float(size.max())
    levels = [k for k in range(1, _LEVELS + 1) if k == 1 or size.max() >= SPACING * 2**k]
    share = np.concatenate([(np.arange(2 ** (k - 1)) + 0.5) / 2 ** (k - 1) for k in levels])
    points = shapely.line_interpolate_point(largest, share, normalized=True)
    return shapely.get_coordinates(points), float(size.max())


class LabelCandidates:
    """Anchors of the labels of the features nearest to an eye, read a few at a time.

    `measure` returns the size (px) of a text with letters of a height (px), `heights` the ground's (m).
    """

    def __init__(
        self,
        measure: Callable[[str, float], tuple[int, int]],
        heights: Callable[[Float64Array, Float64Array], npt.NDArray[np.floating]],
    ) -> None:
        self._measure, self._heights = measure, heights
        self._drapes: Drapes | None = None
        self._cell: tuple[float, ...] = ()
        self._keys: list[object] = []
        self._read = self._pending = np.zeros(0, np.int64)  # features; the nearest pending one comes first
        self.anchors = np.zeros(0, ANCHOR)
        self.labels: list[Label] = []

    @property
    def layers(self) -> tuple[DrapedLayer, ...]:
        """The draped layers, by the numbers of labels."""
        return () if self._drapes is None else self._drapes.layers

    @property
    def complete(self) -> bool:
        """Whether all features around the last eye are read."""
        return not len(self._pending)

    def set_drapes(self, drapes: Drapes | None) -> None:
        """Replace the layers; labels stay if only looks and edits of other features differ."""
        old, self._drapes, self._cell = self.layers, drapes, ()
        before, self._keys = self._keys, [_label_key(layer) for layer in self.layers]
        stale = [
            (number << _ID_BITS) + name
            for number, (one, other) in enumerate(zip(old, self.layers, strict=False))
            for name in {**one.edits, **other.edits}
            if one.edits.get(name, 0) != other.edits.get(name, 0)
        ]
        self._keep(np.setdiff1d(self._read, stale) if before == self._keys else self._read[:0])

    def update(self, eye: tuple[float, float, float], above: float, seconds: float) -> None:
        """Read features around an eye, `above` m above the ground, for about so many seconds."""
        step = 2.0 ** round(math.log2(max(above, _LOWEST)))
        cell = (step, math.floor(eye[0] / step), math.floor(eye[1] / step))
        if cell != self._cell:
            self._cell = cell
            wanted = self._nearest()
            self._keep(wanted)
            self._pending = wanted[~np.isin(wanted, self._read)]
        end, new = time.perf_counter() + seconds, list[StructuredArray]()
        for feature in self._pending.tolist():
            new.append(self._anchors_of(feature))
            if time.perf_counter() > end:
                break
        if new:
            self._read = np.append(self._read, self._pending[: len(new)])
            self._pending = self._pending[len(new) :]
            rows = np.concatenate(new)
            self._raise(rows)
            rows = np.concatenate([self.anchors, rows])
            self.anchors = rows[np.lexsort((rows["feature"], -rows["weight"], -layer_numbers(rows)))]

    def set_heights(self) -> None:
        """Place anchors on the ground, which has changed."""
        self._raise(self.anchors)

    def _raise(self, rows: StructuredArray) -> None:
        rows["place"][:, 2] = self._heights(rows["place"][:, 0], rows["place"][:, 1])

    def _keep(self, features: Int64Array) -> None:
        self._read = self._read[np.isin(self._read, features)]
        self.anchors = self.anchors[np.isin(self.anchors["feature"], features)]
        numbers, self.anchors["label"] = np.unique(self.anchors["label"], return_inverse=True)
        self.labels = [self.labels[number] for number in numbers.tolist()]

    def _nearest(self) -> Int64Array:
        """Return features in squares around the cell's centre, each twice as wide as the one before."""
        step, column, row = self._cell
        x, y, half = (column + 0.5) * step, (row + 0.5) * step, _NEAREST * step
        found = np.zeros(0, np.int64)
        while (drapes := self._drapes) is not None and len(found) < MOST_FEATURES:
            for number in (number for number, key in enumerate(self._keys) if key is not None):
                ids = np.asarray(drapes.features(number, (x - half, y - half, x + half, y + half)), np.int64)
                found = np.append(found, ids[: len(found) + MOST_FEATURES] + (number << _ID_BITS))
            found = found[np.sort(np.unique(found, return_index=True)[1])]
            if half > 2.0 * drapes.extent:
                break
            half *= 2.0
        return found[:MOST_FEATURES]

    def _anchors_of(self, feature: int) -> StructuredArray:
        assert self._drapes is not None  # noqa: S101 # it listed the feature
        number = feature >> _ID_BITS
        layer = self.layers[number]
        table, name = self._drapes.table(number), feature & ((1 << _ID_BITS) - 1)
        geometry, properties = table.geometry(name), table.feature(name).properties
        number = layer.class_numbers.get(class_value(properties.get(layer["by"])), -1)
        style = layer.style_of(number)
        label = Label(label_text(properties.get(style["label"])), number)
        places, weight = anchors(geometry)
        rows = np.zeros(len(places) if label.text else 0, ANCHOR)
        if len(rows):
            self.labels.append(label)
            rows["feature"], rows["label"], rows["weight"] = feature, len(self.labels) - 1, weight
            rows["place"][:, :2], rows["size"] = places, self._measure(label.text, style["label_size"])
            half = 0.5 * style["width"] if style["unit"] == "px" else 0.0
            is_area = shapely.get_dimensions(geometry) == 2
            rows["rise"] = -0.5 * rows["size"][:, 1] if is_area else GAP + half
            rows["steady"] = 0.5
        return rows


def place_labels(
    rows: StructuredArray, clip: Float64Array, size: tuple[int, int], *, elapsed: float, settled: bool
) -> Float64Array:
    """Choose the labels of a picture and fade them; return boxes (n, 4), px from the lower left corner.

    `clip` (n, 4) are the anchors' clip coordinates, with w ≤ 0 for what is not to be shown, `elapsed` the
    seconds since the last picture. Labels that are shown come first and disappear only when they are hidden,
    outside or overlap each other. A `settled` choice depends on nothing but the view and ``seen``.
    """
    at = (clip[:, :2] / np.maximum(clip[:, 3:], 1e-3) * 0.5 + 0.5) * size
    low = at + np.stack([-0.5 * rows["size"][:, 0], rows["rise"]], axis=-1)
    boxes = np.concatenate([low, low + rows["size"]], axis=1)
    kept, step = rows["shown"] & (not settled), elapsed / FADE
    beyond = np.where(kept[:, None], rows["size"], 0.0)  # a label leaves the picture as a whole
    room = np.minimum(low, size - boxes[:, 2:]) + beyond
    inside = (clip[:, 3] > 0.0) & (np.minimum(room[:, 0], room[:, 1]) >= 0.0)
    rows["steady"] = np.clip(rows["steady"] + np.where(rows["seen"], step, -step), -1.0, 1.0)
    fits = inside & (rows["seen"] if settled else rows["steady"] >= np.where(kept, 1e-6, 1.0))
    state = np.where(kept, 2, (rows["opacity"] > 0.0) & (not settled)).astype(np.int8)
    order = np.flatnonzero(fits | (state == 1))
    chosen = choose(order[np.argsort(-state[order], kind="stable")], boxes, rows["label"].copy(), state)
    new = np.flatnonzero(chosen & ~rows["shown"])
    rows["waits"] = False
    if math.isfinite(elapsed):
        chosen[new[NEW:]], rows["waits"][new[NEW:]] = False, True
    rows["steady"][rows["shown"] & fits & ~chosen] = -1.0  # it overlaps another: not again at once
    rows["shown"] = chosen
    rows["opacity"] = np.clip(rows["opacity"] + np.where(chosen, step, -step), 0.0, 1.0) * inside
    return boxes


def choose(
    order: Int64Array, boxes: Float64Array, labels: Int64Array, state: npt.NDArray[np.int8]
) -> BoolArray:
    """Return which labels are shown, (n,): in `order`, those that overlap none before them.

    `state` is 2 for those that are shown already, 1 for those that fade out there, 0 for others.
    """
    chosen, given = np.empty(len(boxes), np.bool_), (order, boxes, labels, state)
    host_function("choose_labels")(*given, MOST_SHOWN, MARGIN, REPEAT, chosen, np.empty_like(order))
    return chosen


def _label_key(layer: DrapedLayer) -> object:
    """Return what a layer's labels depend on besides their colour; None if it has none."""
    styles = [layer.style_of(number) for number in range(-1, len(layer.classes))]
    if not layer["visible"] or not any(style["label"] for style in styles):
        return None
    names = ("label", "label_size", "width", "unit")
    classes = (layer["by"], *(each.value for each in layer.classes))
    return layer.source_key, classes, tuple(tuple(style[name] for name in names) for style in styles)
