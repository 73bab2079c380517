"""Normals and material weights of a whole grid as PNG images beside a mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.export.png import write_values_png
from sketchterrain.export.weights import four_of

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.export.target import Export

__all__ = ["ground_images"]


def ground_images(export: Export) -> dict[Path, str]:
    """Write ``NAME_normal.png``, ``NAME_materials.png``, ``NAME_materials-2.png`` …; return what each is.

    A texel a vertex, row 0 the north edge; four materials an image.
    """
    names, folder = export.terrain.material_names, export.folder
    normal = folder / f"{export.name}_normal.png"
    files = {
        write_values_png(normal, export.sampled.normal): (
            "normals, red east, green north (Y+), blue up; 0 is -1, 255 is 1"
        )
    }
    for number, first in enumerate(range(0, len(names), 4), start=1):
        path = folder / f"{export.name}_materials{f'-{number}' if number > 1 else ''}.png"
        held = ", ".join(names[first : first + 4])
        files[write_values_png(path, four_of(export.sampled.weights, first))] = (
            f"weights of {held}; no opacity"
        )
    return files
