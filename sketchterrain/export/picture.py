"""Rendered pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.export.files import write_png

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

__all__ = ["write_picture"]


def write_picture(path: Path, pixels: npt.NDArray[np.uint8]) -> tuple[Path, ...]:
    """Write a picture, (height, width, 3) of uint8, as a PNG at `path`."""
    return (write_png(path, pixels),)
