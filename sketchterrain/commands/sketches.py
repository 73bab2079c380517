"""The sketch that a command is about."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sketchterrain.progress import Stages
    from sketchterrain.sketch import Sketch


def read_sketch(name: str, seed: int | None, stages: Stages) -> Sketch:
    """Read the sketch that a command was given, with another seed if one was asked for."""
    with stages.stage("sketch", "Reading the sketch"):
        from sketchterrain.sketch import load_sketch  # NumPy and Pillow: not for a command's --help

        sketch = load_sketch(name)
        return sketch if seed is None else sketch.replace(seed=seed)
