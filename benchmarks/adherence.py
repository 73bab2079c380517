"""What `fidelity` does: how far the terrain obeys its sketch, and whether the sketch shows in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.naturalness import measure_naturalness
from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.document.store import load_sketch
from sketchterrain.terrain.adherence import measure_adherence
from sketchterrain.terrain.building import build

if TYPE_CHECKING:
    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext

_COLUMNS = (
    Column("preset", "preset"),
    Column("fidelity", "fidelity"),
    Column("shapes", "shapes"),
    Column("lost", "lost"),
    Column("iou_mean", "overlap, mean"),
    Column("iou_p10", "10 % below"),
    Column("peak_least", "peaks, least"),
    Column("peak_most", "peaks, most"),
    Column("centreline_px", "centreline, px"),
    Column("curvature", "curvature along outlines"),
    Column("slope", "slope along outlines"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Adherence and naturalness of each preset at fidelities from 0 to 1; nothing is timed.

    `overlap` is the intersection over union of painted and risen areas over all shapes at least six pixels
    wide, `peaks` reached over asked-for height of mountains, `centreline` the mean distance from painted to
    placed rivers in sketch pixels. `curvature` and `slope` are means along the painted outlines of mountains
    and hills over those of the ground beside them: 1 where an outline does not show.
    """
    rows: list[Row] = []
    for name in effort.presets:
        for fidelity in effort.fidelities:
            terrain = build(load_sketch(name).replace(fidelity=fidelity), device=context)
            found, natural = measure_adherence(terrain), measure_naturalness(terrain)
            overlaps = [shape.iou for shape in found.shapes if shape.iou is not None]
            courses = [river.mean_distance for river in found.rivers if river.mean_distance is not None]
            rows.append(
                {
                    "preset": name,
                    "fidelity": fidelity,
                    "shapes": sum(layer.shapes for layer in found.layers.values()),
                    "lost": found.lost,
                    "iou_mean": found.mean_iou,
                    "iou_p10": float(np.percentile(overlaps, 10)) if overlaps else None,
                    "peak_least": found.peaks.least,
                    "peak_most": found.peaks.most,
                    "centreline_px": float(np.mean(courses)) if courses else None,
                    "curvature": natural.curvature,
                    "slope": natural.slope,
                }
            )
    return Outcome((Table("Fidelity, adherence and naturalness", _COLUMNS, tuple(rows)),))
