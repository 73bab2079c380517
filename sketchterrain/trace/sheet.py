"""The sketch that something is traced to: its pixels, its extent, its name, its picture."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS, SKETCH, Sketch
from sketchterrain.sketch.document import MAX_LABELS, MAX_SIDE, labels_in
from sketchterrain.sketch.label_colours import DRAW_ORDER, label_rgb
from sketchterrain.sketch.parameter import Value
from sketchterrain.trace.label_image import scaled_size

LONGEST: Final = 1024  # px along the longer side at most, unless more are asked for

_GAP = 8  # px between a sketch's picture and its source's
_TALLEST = 1024  # px of the picture


@dataclass(frozen=True)
class Sheet:
    """Options of a traced sketch; raise `InputError` for values that no sketch can have."""

    size_px: int | None = None
    extent: float | None = None
    name: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.size_px is not None and not 1 <= self.size_px <= MAX_SIDE:
            raise InputError(f"size: expected 1 to {MAX_SIDE} px, got {self.size_px}")
        for key in ("extent", "name", "seed"):
            value = getattr(self, key)
            if value is not None:
                SKETCH[key].check(value)

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Return the sketch's (width, height), px, for something of another size."""
        longest = max(width, height)
        return scaled_size(width, height, self.size_px or min(longest, LONGEST))

    def sketch(self, layers: Mapping[str, npt.NDArray[np.uint8]], called: str) -> tuple[Sketch, list[str]]:
        """Return the sketch of layers' images, uint8 (height, width) of one size, and notes on it."""
        there = {name: image for name, image in layers.items() if image.any()}
        labels: dict[tuple[str, int], dict[str, Value]] = {}
        for name, image in there.items():
            found = labels_in(image)
            if len(found) > MAX_LABELS:
                raise InputError(f"{len(found)} labels on layer {name}: expected at most {MAX_LABELS}")
            table = LAYERS[name].parameters
            labels |= {(name, label): {key: table[key].default for key in table} for label in found}
        longest = SKETCH["name"].high
        sketch = Sketch(
            name=self.name if self.name is not None else called[: int(longest)],
            seed=self.seed,
            layers=layers,
            labels=labels,
            extent=float(SKETCH["extent"].default) if self.extent is None else self.extent,
        )
        told = []
        if self.extent is None:
            told.append(f"extent: {sketch.extent:g} m along the longer side, for none was given")
        told.append(
            f"{sketch.width_px}×{sketch.height_px} px, {sketch.pixel_size:.4g} m each: "
            + (
                ", ".join(f"{name} {'+'.join(map(str, labels_in(image)))}" for name, image in there.items())
                or "nothing"
            )
        )
        return sketch, told


@dataclass(frozen=True, eq=False)
class Traced:
    """A sketch made from something else, and notes: what was taken, left out and guessed, one line each."""

    sketch: Sketch
    notes: tuple[str, ...]


def sketch_picture(sketch: Sketch) -> npt.NDArray[np.uint8]:
    """Return what a sketch looks like on white paper: uint8, (height, width, 3), sRGB."""
    shown = np.full((sketch.height_px, sketch.width_px, 3), 255, dtype=np.uint8)
    for layer in DRAW_ORDER:
        image = sketch.layers[layer]
        for label in labels_in(image):
            shown[image == label] = label_rgb(layer, label)
    return shown


def preview_png(sketch: Sketch, source: npt.NDArray[np.uint8] | None = None) -> bytes:
    """Return a PNG of a sketch, at the right of its source if one is given: uint8, (height, width, 4)."""
    traced = Image.fromarray(sketch_picture(sketch))
    height = min(traced.height, _TALLEST)
    size = max(1, round(traced.width * height / traced.height)), height
    traced = traced.resize(size, Image.Resampling.NEAREST)
    if source is not None:
        beside = Image.new("RGB", (2 * size[0] + _GAP, height), (128, 128, 128))
        original = Image.fromarray(source).resize(size, Image.Resampling.BOX)
        beside.paste(original, (0, 0), original)
        beside.paste(traced, (size[0] + _GAP, 0))
        traced = beside
    stream = io.BytesIO()
    traced.save(stream, format="PNG")
    return stream.getvalue()
