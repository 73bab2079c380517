"""Shapes in metres painted on the layers of a sketch, with the labels that their properties ask for."""

from __future__ import annotations

import math
from collections import Counter
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS
from sketchterrain.sketch.document import MOST_LABELS
from sketchterrain.trace.label_classes import classed
from sketchterrain.trace.mapped_shapes import WIDE
from sketchterrain.trace.stroke_painting import paint_areas, paint_lines

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.sketch.document import LabelImage
    from sketchterrain.sketch.parameter import Value
    from sketchterrain.trace.label_classes import LabelClasses
    from sketchterrain.trace.mapped_shapes import MappedShape, MappedShapes
    from sketchterrain.trace.vector_place import Area

__all__ = ["Painting", "painted"]

_WIDTHS = 8  # a pixel: lines whose widths differ by less are painted at once


class Painting(NamedTuple):
    """What was painted.

    Attributes
    ----------
    layers : dict of str to label image
    labels : dict
        Properties by (layer name, label).
    left_out : Counter
        How many shapes left no mark, by why.
    notes : tuple of str
    """

    layers: dict[str, LabelImage]
    labels: dict[tuple[str, int], dict[str, Value]]
    left_out: Counter[str]
    notes: tuple[str, ...]


def painted(found: MappedShapes, width: float | None) -> Painting:
    """Paint shapes.

    A river is as wide as it is, at least a pixel, and 8-connected; other lines and points are as wide as they
    say, else as `width`, else a twenty-fifth of the longer side. Where shapes of a layer overlap, an area of
    a river or else the widest line counts, and elsewhere the label that appears last.

    Parameters
    ----------
    found
    width
        m, of lines that say none.

    Raises
    ------
    InputError
        If no shape leaves a mark.
    """
    left_out: Counter[str] = Counter()
    shapes = [shape for shape in found.shapes if _leaves_a_mark(shape, found.area, left_out)]
    if not shapes:
        raise InputError(
            f"nothing of it is to be seen ({', '.join(f'{n} {why}' for why, n in left_out.items())})"
        )
    order = {name: rank for rank, name in enumerate(LAYERS)}
    shapes.sort(key=lambda shape: order[shape.wanted.layer])  # stable: else in the order of the file
    layers: dict[str, LabelImage] = {}
    labels: dict[tuple[str, int], dict[str, Value]] = {}
    notes = [f"taken: {_counts(shapes)}"]
    for name, group in groupby(shapes, key=lambda shape: shape.wanted.layer):
        ones = list(group)
        classes = classed([_properties(shape, width) for shape in ones], MOST_LABELS)
        image, properties = _painted_layer(name, ones, classes, found.area, width)
        layers[name] = image
        labels |= {(name, label): each for label, each in enumerate(properties, start=1)}
        if classes.error:
            off = f"their numbers are off by up to {100 * classes.error:.2g} %"
            lost = "all have the defaults, for even so there were more"
            told = off if math.isfinite(classes.error) else lost
            notes.append(f"{name}: {MOST_LABELS} labels at most, so some share one; {told}")
    return Painting(layers, labels, left_out, (*notes, *_guesses(shapes, found.area, width)))


def _properties(shape: MappedShape, width: float | None) -> dict[str, Value]:
    wanted = dict(shape.wanted.properties)
    if shape.wanted.layer != "river":
        return wanted
    if shape.kind == "area":
        return wanted | {"width": 0.0}  # as wide as it is painted
    if width is not None and ("width" not in wanted or "width" in shape.wanted.guessed):
        table = LAYERS["river"].parameters["width"]
        wanted["width"] = min(width, table.high)
    return {"width": LAYERS["river"].parameters["width"].default, **wanted}


def _painted_layer(
    name: str,
    shapes: Sequence[MappedShape],
    classes: LabelClasses,
    area: Area,
    width: float | None,
) -> tuple[LabelImage, list[dict[str, Value]]]:
    size = (area.rows, area.columns)
    image = np.zeros(size, dtype=np.uint8)
    order = list(range(len(classes.properties)))
    river = name == "river"
    if river:
        # As wide as painted is wider than any: maps have a line in the middle of a river's area too.
        order.sort(key=lambda index: _river_width(classes.properties[index]) or math.inf)
    for label, index in enumerate(order, start=1):
        ones = [shape for shape, of in zip(shapes, classes.of, strict=True) if of == index]
        areas = [[area.pixels(part) for part in shape.parts] for shape in ones if shape.kind == "area"]
        mask = paint_areas(size, areas, touched=river)
        lines: dict[float, list[npt.NDArray[np.float64]]] = {}
        for shape in ones:
            if shape.kind != "area":
                wide = _river_width(classes.properties[index]) if river else _wide(shape, area, width)
                alike = round(_WIDTHS * wide / area.pixel) / _WIDTHS
                lines.setdefault(alike, []).extend(area.pixels(part) for part in shape.parts)
        for wide, parts in lines.items():
            mask |= paint_lines(size, np.concatenate(parts), wide)
        image[mask] = label
    return image, [classes.properties[index] for index in order]


def _river_width(properties: Mapping[str, Value]) -> float:
    return float(properties.get("width", LAYERS["river"].parameters["width"].default))


def _wide(shape: MappedShape, area: Area, width: float | None) -> float:
    """Return how wide a line or disc is, m, on a layer of areas."""
    if shape.width is not None:
        return shape.width
    return width if width is not None and shape.kind == "line" else WIDE * area.extent


def _leaves_a_mark(shape: MappedShape, area: Area, left_out: Counter[str]) -> bool:
    places = area.pixels(np.concatenate([part.reshape(-1, 2) for part in shape.parts]))
    low, high = places.min(axis=0), places.max(axis=0)
    reach = 0.0 if shape.kind == "area" else 0.5 * (shape.width or 0.0) / area.pixel
    if np.any(high < -reach) or np.any(low > np.array([area.columns, area.rows]) + reach):
        left_out["outside"] += 1
        return False
    if shape.kind == "area" and np.all(high - low < 0.5):
        left_out["smaller than half a pixel"] += 1
        return False
    return True


def _counts(shapes: Sequence[MappedShape]) -> str:
    kinds = Counter((shape.wanted.layer, shape.kind) for shape in shapes)
    return ", ".join(
        f"{count} {kind}{'s' if count > 1 else ''} as {layer}" for (layer, kind), count in kinds.items()
    )


def _guesses(shapes: Sequence[MappedShape], area: Area, width: float | None) -> list[str]:
    """Tell what was not in the file, and what of it was not taken as it stands."""
    notes = []
    rivers = [shape for shape in shapes if shape.wanted.layer == "river" and shape.kind == "line"]
    bare = sum("width" not in shape.wanted.properties or "width" in shape.wanted.guessed for shape in rivers)
    if bare:
        default = f"{width:g} m" if width is not None else "by their kind: 12 m, streams 3 m, ditches 1.5 m"
        notes.append(f"lines of rivers that say no width ({bare} of {len(rivers)}): {default}")
    guessed = sum(
        shape.width is None and shape.kind != "area" and shape.wanted.layer != "river" for shape in shapes
    )
    if guessed:
        notes.append(
            f"lines and points that say nothing of their size ({guessed}): "
            f"{WIDE * area.extent:.4g} m wide{'' if width is None else f', lines {width:g} m'}"
        )
    clipped = sum(shape.wanted.clipped for shape in shapes)
    unread = sum(shape.wanted.unread for shape in shapes)
    if clipped:
        notes.append(f"{clipped} numbers were out of range and went to its end")
    if unread:
        notes.append(f"{unread} properties could not be read and have their defaults")
    return notes
