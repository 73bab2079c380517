"""Draped features in appearance tiles: shares of texels against exact areas, and time."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import shapely

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.draped_data import Shapes, random_areas, random_lines, write_layer
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.report import Column, Row, Table
from sketchterrain.benchmarks.timing import TimedContext, alternate, spread
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.sketch import Sketch
from sketchterrain.drape.drapes import Drapes
from sketchterrain.drape.painting import DrapedAppearance

TEXEL: Final = 2.0  # m
_SIDE: Final = 190  # texels of the square
_WIDTHS: Final = (0.2, 0.6, 1.0, 2.0, 5.0, 20.0)  # texels
_COUNT: Final = 40  # features

_COLUMNS = (
    Column("what", "features"),
    Column("method", "method"),
    Column("ms", "ms a tile"),
    Column("share", "share, largest"),
    Column("share_p99", "99 %"),
    Column("whole", "of all texels, %"),
)


def _drapes(
    context: ComputeContext, folder: Path, *layers: tuple[Shapes, dict[str, object]]
) -> DrapedAppearance:
    """Return layers of shapes that are drawn in white."""
    extent, opened = _SIDE * TEXEL, list[DrapedLayer]()
    for shapes, style in layers:
        path = write_layer(folder / f"{len(list(folder.iterdir()))}.fgb", shapes)
        look = {"unit": "m", "colour": "#ffffff", "fill_opacity": 1.0, **style}
        opened.append(DrapedLayer(str(path), {}, look))
    return DrapedAppearance(Drapes.open(opened, Sketch().frame, (extent, extent), extent), context, extent)


def kernel_drapes(context: ComputeContext, folder: Path) -> DrapedAppearance:
    """Return a hundred and fifty lines over as many areas, for a tile."""
    extent = _SIDE * TEXEL
    areas, lines = random_areas(150, extent, radius=12.0), random_lines(150, extent, points=12, step=8.0)
    return _drapes(context, folder, (areas, {"fill": "#ffffff", "width": 4.0}), (lines, {"width": 4.0}))


def drape_table(context: TimedContext, effort: Effort) -> Table:
    """Compare the shares of texels with exact areas, and so the means of smaller texels."""
    extent, rows = _SIDE * TEXEL, list[Row]()
    areas, lines = random_areas(_COUNT, extent), random_lines(_COUNT, extent, step=15.0)
    with TemporaryDirectory() as name:
        paint = _drapes(context, Path(name), (areas, {"fill": "#ffffff", "colour": ""}))
        rows += _rows("areas", paint, areas, context, effort)
        for width in _WIDTHS:
            shapes = shapely.buffer(lines, 0.5 * width * TEXEL, quad_segs=32)
            paint = _drapes(context, Path(name), (lines, {"width": width * TEXEL}))
            rows += _rows(f"lines of {width:g} texels", paint, shapes, context, effort)
    return Table("Draped features", _COLUMNS, tuple(rows))


def _rows(
    what: str, paint: DrapedAppearance, shapes: Shapes, context: TimedContext, effort: Effort
) -> Iterator[Row]:
    true = _exact(shapely.union_all(shapes))
    works = {many: partial(_shares, paint, many) for many in (1, 2, 4)}
    laps = alternate(
        {str(many): partial(context.lap, work) for many, work in works.items()}, rounds=effort.rounds
    )
    for many, work in works.items():
        found = work()
        error = np.abs(found - true)[(found > 0.0) | (true > 0.0)]
        seconds = [sum(one.seconds for one in lap.launches) for lap in laps[str(many)]]
        yield {
            "what": what,
            "method": "kernel" if many == 1 else f"{many * many} texels",
            "ms": spread(seconds).median * 1e3,
            "share": float(error.max()),
            "share_p99": float(np.quantile(error, 0.99)),
            "whole": float(100.0 * found.sum() / true.sum()),
            "seconds": seconds,
        }


def _shares(paint: DrapedAppearance, many: int) -> Float64Array:
    cell, count = TEXEL / many, _SIDE * many
    texels = paint.window(
        0.5 * cell, _SIDE * TEXEL - 0.5 * cell, cell=(cell, cell), columns=count, rows=count
    )
    return np.asarray(texels[..., 3].reshape(_SIDE, many, _SIDE, many).mean(axis=(1, 3)) / 255.0)


def _exact(shape: shapely.Geometry) -> Float64Array:
    """Return the shares of texels in a shape."""
    west, south = TEXEL * np.arange(_SIDE), TEXEL * np.arange(_SIDE)[::-1, None]
    boxes = shapely.box(west, south, west + TEXEL, south + TEXEL)
    shapely.prepare(shape)
    return np.asarray(shapely.area(shapely.intersection(boxes, shape)) / TEXEL**2)
