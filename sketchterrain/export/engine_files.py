"""What the files of an export to an engine are called, tile by tile."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sketchterrain.export.sampled import Sampled
    from sketchterrain.export.target import Export
    from sketchterrain.export.tiling import Piece

__all__ = ["path_of", "tiles_of"]


def path_of(export: Export, what: str, piece: Piece, ending: str) -> Path:
    """Return the path of a tile's file of one kind: ``valley_grass_x0_y0.png``.

    Parameters
    ----------
    export
    what
        The kind; empty for a target's main files, which bear the sketch's name alone.
    piece
    ending
        Of the file's name, with its dot.
    """
    tiling = export.tiling
    name = tiling.name("_".join(each for each in (export.name, what) if each), piece)
    if what and tiling.count > 1 and "{name}" not in tiling.pattern:
        name = f"{what}_{name}"  # else all kinds would have one name
    return export.folder / f"{name}{ending}"


def tiles_of(export: Export) -> Iterator[tuple[Piece, Sampled]]:
    """Return the tiles and what is known at their vertices, from the north-west, row by row."""
    for piece in export.tiling.pieces(export.grid.columns, export.grid.rows):
        yield piece, export.sampled.part(piece.left, piece.top, piece.columns, piece.rows)
