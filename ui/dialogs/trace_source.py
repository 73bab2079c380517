"""What a new sketch is traced from: read once, then traced as often as options change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.sketch.document import DEFAULT_SIDE
from sketchterrain.trace.coloured_map import ColouredMap, map_of
from sketchterrain.trace.layered import trace_folder, trace_mask, trace_open_raster
from sketchterrain.trace.legend import Meaning
from sketchterrain.trace.picture import Kind, kind_of, read_picture
from sketchterrain.trace.sheet import Sheet, Traced, sketch_picture

_SHOWN = 900  # px along the longer side of what is shown


@dataclass(frozen=True, eq=False)
class TraceSource:
    """A file that was read.

    Attributes
    ----------
    path : Path
    kind : {'picture', 'folder', 'open raster', 'vectors'}
    map : ColouredMap or None
        If it is a coloured map.
    shown : numpy.ndarray or None
        uint8, (height, width, 4): what it looks like, if it is a picture.
    """

    path: Path
    kind: Kind
    map: ColouredMap | None = None
    shown: npt.NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class TracedShown:
    """What was traced, and what it looks like: uint8, (height, width, 4)."""

    traced: Traced
    shown: npt.NDArray[np.uint8]


def read_source(path: Path) -> TraceSource:
    """Read a file; slow for large pictures."""
    kind = kind_of(path)
    if kind != "picture":
        return TraceSource(path, kind)
    picture = read_picture(path)
    shown = _smaller(picture.rgba, Image.Resampling.BOX)
    return TraceSource(path, kind, None if picture.is_grey else map_of(picture, path), shown)


def trace_source(
    source: TraceSource,
    sheet: Sheet,
    *,
    meanings: Sequence[Meaning | None],
    layer: str,
    specks: int,
    narrow: float,
) -> TracedShown:
    """Trace what was read."""
    if source.map is not None:
        traced: Traced = source.map.traced(sheet, meanings=meanings, specks=specks, narrow=narrow)
    elif source.kind == "picture":
        traced = trace_mask(source.path, layer, sheet)
    elif source.kind == "folder":
        traced = trace_folder(source.path, sheet)
    elif source.kind == "open raster":
        traced = trace_open_raster(source.path, sheet)
    else:
        traced = _from_vectors(source.path, sheet)
    opaque = np.full((traced.sketch.height_px, traced.sketch.width_px, 4), 255, dtype=np.uint8)
    opaque[..., :3] = sketch_picture(traced.sketch)
    return TracedShown(traced, _smaller(opaque, Image.Resampling.NEAREST))


def _from_vectors(path: Path, sheet: Sheet) -> Traced:
    from sketchterrain.trace.vectors import sketch_from_vectors

    return sketch_from_vectors(path, name=sheet.name, size_px=sheet.size_px or DEFAULT_SIDE)


def _smaller(rgba: npt.NDArray[np.uint8], how: Image.Resampling) -> npt.NDArray[np.uint8]:
    image = Image.fromarray(rgba)
    scale = _SHOWN / max(image.size)
    if scale < 1.0:
        image = image.resize((max(1, round(image.width * scale)), max(1, round(image.height * scale))), how)
    return np.asarray(image)
