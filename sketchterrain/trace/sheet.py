"""The sketch that something is traced to: its pixels, its extent, its name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS, SKETCH, Sketch
from sketchterrain.sketch.document import LARGEST_SIDE, MOST_LABELS, labels_in
from sketchterrain.trace.majority import scaled_size

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.sketch.parameter import Value

__all__ = ["LONGEST", "Sheet"]

LONGEST: Final = 1024
"""The most pixels along the longer side unless more are asked for."""


@dataclass(frozen=True)
class Sheet:
    """What a traced sketch shall be; what is None is found.

    Parameters
    ----------
    size_px
        Pixels along the longer side; by default those of the picture, at most `LONGEST`.
    extent
        Metres along the longer side; by default a sketch's own.
    name
        By default that of what is traced.
    seed

    Raises
    ------
    InputError
        If a value is none that a sketch can have.
    """

    size_px: int | None = None
    extent: float | None = None
    name: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.size_px is not None and not 1 <= self.size_px <= LARGEST_SIDE:
            raise InputError(f"size: expected 1 to {LARGEST_SIDE} px, got {self.size_px}")
        for key in ("extent", "name", "seed"):
            value = getattr(self, key)
            if value is not None:
                SKETCH[key].check(value)

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Return the sketch's (width, height), px, for something of another size."""
        longest = max(width, height)
        return scaled_size(width, height, self.size_px or min(longest, LONGEST))

    def sketch(self, layers: Mapping[str, npt.NDArray[np.uint8]], called: str) -> tuple[Sketch, list[str]]:
        """Return the sketch of layers' images, and what is to be told of it.

        Parameters
        ----------
        layers
            uint8, (height, width), by name; all of one size.
        called
            Its name if none was given.
        """
        there = {name: image for name, image in layers.items() if image.any()}
        labels: dict[tuple[str, int], dict[str, Value]] = {}
        for name, image in there.items():
            found = labels_in(image)
            if len(found) > MOST_LABELS:
                raise InputError(f"{len(found)} labels on layer {name}: expected at most {MOST_LABELS}")
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
            + (", ".join(f"{name} {_numbers(image)}" for name, image in there.items()) or "nothing")
        )
        return sketch, told


def _numbers(image: npt.NDArray[np.uint8]) -> str:
    return "+".join(str(label) for label in labels_in(image))
