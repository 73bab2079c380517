"""What a person does with labels and their properties."""

from __future__ import annotations

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.sketch.document import MAX_LABELS, LabelImage
from sketchterrain.sketch.parameter import Value

_PIXELS_AT_ONCE = 1 << 20


def label_areas(image: LabelImage) -> dict[int, int]:
    """Return the pixels that each label, 1 to 255, covers in a label image; only labels that stand in it."""
    rows = max(1, _PIXELS_AT_ONCE // max(1, image.shape[1]))
    counts = np.zeros(256, dtype=np.int64)
    for top in range(0, image.shape[0], rows):  # bincount widens its input eightfold
        counts += np.bincount(image[top : top + rows].ravel(), minlength=256)
    return {int(label): int(counts[label]) for label in np.flatnonzero(counts) if label}


def labels_of(sketch: Sketch, layer: str) -> tuple[int, ...]:
    """Return the labels of a layer that are painted or have properties of their own, ascending."""
    declared = {label for name, label in sketch.labels if name == layer}
    return tuple(sorted(declared | set(label_areas(sketch.layers[layer]))))


def free_label(sketch: Sketch, layer: str) -> int:
    """Return the smallest label of a layer that is neither painted nor declared."""
    taken = labels_of(sketch, layer)
    if len(taken) >= MAX_LABELS:
        raise InputError(f"{LAYERS[layer].title}: a layer has at most {MAX_LABELS} labels")
    return next(label for label in range(1, 256) if label not in taken)


def new_label(sketch: Sketch, layer: str, label: int) -> Sketch:
    """Declare a label, with the default properties."""
    if (layer, label) in sketch.labels:
        return sketch
    return sketch.replace(labels={**sketch.labels, (layer, label): {}})


def copy_label(sketch: Sketch, layer: str, label: int, *, source: int) -> Sketch:
    """Declare a label with the properties of another one of its layer."""
    properties = dict(sketch.labels.get((layer, source), {}))
    return sketch.replace(labels={**sketch.labels, (layer, label): properties})


def delete_label(sketch: Sketch, layer: str, label: int) -> Sketch:
    """Remove a label: its properties and all that is painted with it."""
    labels = {key: value for key, value in sketch.labels.items() if key != (layer, label)}
    image = sketch.layers[layer]
    painted = image == label
    if not painted.any():
        return sketch if len(labels) == len(sketch.labels) else sketch.replace(labels=labels)
    erased = np.where(painted, np.uint8(0), image)
    return sketch.replace(labels=labels, layers={**sketch.layers, layer: _frozen(erased)})


def clear_layer(sketch: Sketch, layer: str) -> Sketch:
    """Erase all that is painted on a layer; its labels keep their properties."""
    image = sketch.layers[layer]
    if not image.any():
        return sketch
    return sketch.replace(layers={**sketch.layers, layer: _frozen(np.zeros_like(image))})


def set_property(sketch: Sketch, layer: str, label: int, name: str, value: Value) -> Sketch:
    """Give a label another value of a property."""
    if sketch.properties(layer, label).get(name) == value:
        return sketch
    properties = {**sketch.labels.get((layer, label), {}), name: value}
    return sketch.replace(labels={**sketch.labels, (layer, label): properties})


def reset_property(sketch: Sketch, layer: str, label: int, name: str) -> Sketch:
    """Give a property of a label its default again."""
    declared = sketch.labels.get((layer, label), {})
    if name not in declared:
        return sketch
    properties = {key: value for key, value in declared.items() if key != name}
    return sketch.replace(labels={**sketch.labels, (layer, label): properties})


def _frozen(image: LabelImage) -> LabelImage:
    image.flags.writeable = False
    return image
