"""Changes of labels and settings: functions from a sketch to a changed sketch."""

from __future__ import annotations

import random
from collections.abc import Mapping

import numpy as np

from sketchterrain.document.label_layers import MAX_LABELS, LabelImage
from sketchterrain.document.parameter_types import Parameter, Value
from sketchterrain.document.parameters import LAYERS, SKETCH, TABLES
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError

_PIXELS_AT_ONCE = 1 << 20


def label_areas(image: LabelImage) -> dict[int, int]:
    """Return the pixel counts of the labels (1 to 255) that occur in an image."""
    rows = max(1, _PIXELS_AT_ONCE // max(1, image.shape[1]))
    counts = np.zeros(256, dtype=np.int64)
    for top in range(0, image.shape[0], rows):  # bincount widens its input eightfold
        counts += np.bincount(image[top : top + rows].ravel(), minlength=256)
    return {int(label): int(counts[label]) for label in np.flatnonzero(counts) if label}


def labels_of(sketch: Sketch, layer: str) -> tuple[int, ...]:
    """Return the painted or declared labels of a layer, ascending."""
    declared = {label for name, label in sketch.labels if name == layer}
    return tuple(sorted(declared | set(label_areas(sketch.layers[layer]))))


def free_label(sketch: Sketch, layer: str) -> int:
    """Return the smallest label of a layer that is neither painted nor declared."""
    used = labels_of(sketch, layer)
    if len(used) >= MAX_LABELS:
        raise InputError(f"{LAYERS[layer].title}: a layer has at most {MAX_LABELS} labels")
    return next(label for label in range(1, 256) if label not in used)


def new_label(sketch: Sketch, layer: str, label: int) -> Sketch:
    """Declare a label with default properties."""
    if (layer, label) in sketch.labels:
        return sketch
    return sketch.replace(labels={**sketch.labels, (layer, label): {}})


def copy_label(sketch: Sketch, layer: str, label: int, *, source: int) -> Sketch:
    """Declare a label with the properties of another label of its layer."""
    properties = dict(sketch.labels.get((layer, source), {}))
    return sketch.replace(labels={**sketch.labels, (layer, label): properties})


def delete_label(sketch: Sketch, layer: str, label: int) -> Sketch:
    """Remove a label: its properties and its paint."""
    labels = {key: value for key, value in sketch.labels.items() if key != (layer, label)}
    image = sketch.layers[layer]
    painted = image == label
    if not painted.any():
        return sketch if len(labels) == len(sketch.labels) else sketch.replace(labels=labels)
    erased = np.where(painted, np.uint8(0), image)
    return sketch.replace(labels=labels, layers={**sketch.layers, layer: _frozen(erased)})


def clear_layer(sketch: Sketch, layer: str) -> Sketch:
    """Erase a layer's paint; its labels keep their properties."""
    image = sketch.layers[layer]
    if not image.any():
        return sketch
    return sketch.replace(layers={**sketch.layers, layer: _frozen(np.zeros_like(image))})


def set_property(sketch: Sketch, layer: str, label: int, name: str, value: Value) -> Sketch:
    """Set a property of a label."""
    if sketch.properties(layer, label).get(name) == value:
        return sketch
    properties = {**sketch.labels.get((layer, label), {}), name: value}
    return sketch.replace(labels={**sketch.labels, (layer, label): properties})


def reset_property(sketch: Sketch, layer: str, label: int, name: str) -> Sketch:
    """Reset a property of a label to its default."""
    declared = sketch.labels.get((layer, label), {})
    if name not in declared:
        return sketch
    properties = {key: value for key, value in declared.items() if key != name}
    return sketch.replace(labels={**sketch.labels, (layer, label): properties})


def _frozen(image: LabelImage) -> LabelImage:
    image.flags.writeable = False
    return image


WORLD = "sketch"
"""Name of the table of top-level keys."""


def declared(table: str) -> Mapping[str, Parameter]:
    """Return the parameters of a table: `WORLD` or a name of ``TABLES``."""
    if table == WORLD:
        return SKETCH
    if table not in TABLES:
        raise InputError(f"no table {table!r}: expected {', '.join((WORLD, *TABLES))}")
    return TABLES[table]


def settings(sketch: Sketch, table: str) -> dict[str, Value]:
    """Return all values of a table, in the order of their declaration."""
    parameters = declared(table)
    if table == WORLD:
        return {name: getattr(sketch, name) for name in parameters}
    return {name: getattr(sketch, table)[name] for name in parameters}


def set_setting(sketch: Sketch, table: str, name: str, value: Value) -> Sketch:
    """Set a value of a table."""
    parameters = declared(table)
    if name not in parameters:
        raise InputError(f"no setting {name!r} in {table}: expected {', '.join(parameters)}")
    if settings(sketch, table)[name] == value:
        return sketch
    if table == WORLD:
        return sketch.replace(**{name: value})
    return sketch.replace(**{table: {**getattr(sketch, table), name: value}})


def reset_setting(sketch: Sketch, table: str, name: str) -> Sketch:
    """Reset a value of a table to its default."""
    return set_setting(sketch, table, name, declared(table)[name].default)


_SEEDS = 1_000_000  # fewer than there are: short enough to remember


def random_seed(current: int | None = None) -> int:
    """Return a short random seed other than the current one."""
    seed = random.randrange(_SEEDS - 1)  # noqa: S311 - not cryptographic
    return seed if current is None else seed + (seed >= current)
