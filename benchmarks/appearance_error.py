"""Appearance tiles: errors of texels of what is painted and draped, and time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.draped_data import Shapes, random_areas, random_lines, write_layer
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import open_ground
from sketchterrain.benchmarks.report import Row, Table
from sketchterrain.benchmarks.synthetic_land import EXTENT, synthetic_land
from sketchterrain.benchmarks.timing import TimedContext, alternate, spread
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.sketch import Sketch
from sketchterrain.drape.drapes import Drapes
from sketchterrain.landuse.areas import FOREST, MEADOW, land_use
from sketchterrain.terrain.appearance import Appearance
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.painted_land import PaintedLand

GROUND = "mountain_pass"
_TEXELS = (0.06, 0.25, 1.0, 4.0, 16.0)  # m
_SIDE = 190  # texels of a square
_SAMPLES = 8  # along a texel, of the reference
AT = (3060.0, 1172.0)  # m: a junction


def open_appearance(context: TimedContext) -> Appearance:
    """Return the roads of `GROUND` among fields of the synthetic country."""
    terrain = open_ground(GROUND, context)
    fields = land_use(synthetic_land(20))
    edges = fields.edges + np.tile(np.array(AT) - 0.5 * EXTENT, 2)
    use = np.where(fields.use == FOREST, MEADOW, fields.use).astype(np.uint8)  # crowns depend on the texel
    areas = replace(fields, use=use, edges=edges)
    recipe = terrain.recipe.with_layers([LandUseLayer(terrain.recipe.materials.names, areas)])
    return Appearance(PaintedLand(recipe, context, terrain.heights))


def appearance_table(context: TimedContext, exact: TimedContext | None, effort: Effort) -> Table:
    """Compare a texel, over which the kernel integrates patterns, with the means of more and smaller ones.

    The reference is the mean of 64 texels of the kernel in doubles.
    """
    rows: list[Row] = []
    if exact is not None:
        ours, truth = open_appearance(context), open_appearance(exact)
        for texel in _TEXELS:
            rows += _rows(ours, truth, texel, context, effort)
    return Table("Appearance", tuple(rows))


def _rows(
    ours: Appearance, truth: Appearance, texel: float, context: TimedContext, effort: Effort
) -> Iterator[Row]:
    reference = _supersampled(truth, texel, _SAMPLES)
    work = partial(_supersampled, ours, texel)
    for method, values, times in _measured(work, partial(_window, ours, texel), context, effort):
        error = np.abs(values - reference)
        yield {
            "texel": texel,
            "method": method,
            "share": float(error[..., 3].max()),
            "share_p99": float(np.quantile(error[..., 3], 0.99)),
            "albedo": float(error[..., :3].max()),
            "albedo_rms": float(np.sqrt((error[..., :3] ** 2).mean())),
            **times,
        }


def _measured(
    work: Callable[[int], Float64Array],
    timed: Callable[[int], object],
    context: TimedContext,
    effort: Effort,
) -> Iterator[tuple[str, Float64Array, Row]]:
    """Yield the values of texels, and the times, of the kernel's own and of means of smaller ones."""
    counts = (1, 2, 4)  # along a texel
    works = {many: partial(context.lap, partial(timed, many)) for many in counts}
    laps = alternate(works, rounds=effort.rounds)
    for many in counts:
        seconds = [sum(one.seconds for one in lap.launches) for lap in laps[many]]
        method = "kernel" if many == 1 else f"{many * many} texels"
        yield method, work(many), {"ms": spread(seconds).median * 1e3, "seconds": seconds}


def _window(paint: Appearance, texel: float, many: int) -> npt.NDArray[np.uint8]:
    """Return a square of so many times more texels."""
    cell = texel / many
    half = 0.5 * _SIDE * texel
    west, north = AT[0] - half + 0.5 * cell, AT[1] + half - 0.5 * cell
    return paint.window(west, north, cell=(cell, cell), columns=many * _SIDE, rows=many * _SIDE)


def _linear(texels: npt.NDArray[np.uint8]) -> Float64Array:
    """Return albedo times share, and share."""
    values = texels / 255.0
    return np.concatenate([values[..., :3] ** 2 * values[..., 3:], values[..., 3:]], axis=-1)


def _supersampled(paint: Appearance, texel: float, many: int) -> Float64Array:
    values = _linear(_window(paint, texel, many))
    return np.asarray(values.reshape(_SIDE, many, _SIDE, many, 4).mean(axis=(1, 3)))


TEXEL: Final = 2.0  # m
_WIDTHS: Final = (0.2, 0.6, 1.0, 2.0, 5.0, 20.0)  # texels
_COUNT: Final = 40  # features

_DRAPE_HEADINGS = {"whole": "of all texels, %"}


def _drapes(context: ComputeContext, folder: Path, *layers: tuple[Shapes, dict[str, object]]) -> Appearance:
    """Return layers of shapes that are drawn in white."""
    extent, opened = _SIDE * TEXEL, list[DrapedLayer]()
    for shapes, style in layers:
        path = write_layer(folder / f"{len(list(folder.iterdir()))}.fgb", shapes)
        look = {"unit": "m", "colour": "#ffffff", "fill_opacity": 1.0, **style}
        opened.append(DrapedLayer(str(path), {}, look))
    drapes = Drapes.open(opened, Sketch().frame, (extent, extent), extent)
    return Appearance(PaintedLand.bare(extent, context)).with_drapes(drapes)


def kernel_drapes(context: ComputeContext, folder: Path) -> Appearance:
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
        rows += _drape_rows("areas", paint, areas, context, effort)
        for width in _WIDTHS:
            shapes = shapely.buffer(lines, 0.5 * width * TEXEL, quad_segs=32)
            paint = _drapes(context, Path(name), (lines, {"width": width * TEXEL}))
            rows += _drape_rows(f"lines of {width:g} texels", paint, shapes, context, effort)
    return Table("Draped features", tuple(rows), _DRAPE_HEADINGS)


def _drape_rows(
    what: str, paint: Appearance, shapes: Shapes, context: TimedContext, effort: Effort
) -> Iterator[Row]:
    true, work = _exact(shapely.union_all(shapes)), partial(_shares, paint)
    for method, found, times in _measured(work, work, context, effort):
        error = np.abs(found - true)[(found > 0.0) | (true > 0.0)]
        yield {
            "what": what,
            "method": method,
            "share": float(error.max()),
            "share_p99": float(np.quantile(error, 0.99)),
            "whole": float(100.0 * found.sum() / true.sum()),
            **times,
        }


def _shares(paint: Appearance, many: int) -> Float64Array:
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
