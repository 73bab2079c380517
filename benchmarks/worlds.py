"""Time and memory of writing worlds."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.plotting import (
    Curves,
    draw_curves,
)
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.timing import run_program

if TYPE_CHECKING:
    from sketchterrain.benchmarks.timing import TimedContext


SKETCH: Final = "valley_river"

_LAYERS = {"raw": "bytes a vertex, raw"}
_WORKERS = {"ratio": "throughput, of alone"}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Seconds and most memory of `world` by its number of vertices, each in a fresh process.

    Squares of valley_river from its south-west corner on, beyond the sketch where they are larger, 1 m apart,
    each written once, as a Zarr store with heights, normals, materials and all coarser levels. Seconds are
    those from the first task to the last file, without the process's start; memory is the most that the
    process has had (VmHWM). What the program estimated before it began stands beside what it took: 1 is
    right. Bytes by layer are those of the largest world. Workers: one world by this process alone and by
    worker processes of the same machine, whose start counts, in turn, a round each; the ratio is of one
    round's times, and the median of rounds is shown.
    """
    device = ["--device", str(context.device.index), *(["--fast"] if context.fast else [])]
    with tempfile.TemporaryDirectory() as folder:
        sizes = []
        for side in effort.world_sides:
            report, layers = _world(Path(folder), side, device)
            sizes.append(_size(side, report))
        workers = _workers(Path(folder), effort, ["--device", str(context.device.index)])
    title = f"{SKETCH}, cells of 1 m, Zarr"
    return (
        Table(title, tuple(sizes)),
        Table(f"Bytes by layer, {effort.world_sides[-1]} vertices a side", tuple(layers), _LAYERS),
        Table(f"Workers, {effort.world_workers_side} vertices a side", tuple(workers), _WORKERS),
    )


def _world(folder: Path, side: int, words: Sequence[str]) -> tuple[dict[str, Any], list[Row]]:
    """Write a world, and return what the program told of it, and its bytes by layer."""
    output = folder / f"{side}.zarr"
    bounds = f"0,0,{side - 1},{side - 1}"
    report = run_program(["world", SKETCH, "--bounds", bounds, "-o", str(output), "--json", *words])
    vertices = report["estimate"]["vertices"]
    rows: list[Row] = []
    for layer, raw in (("height", 4), ("normal", 3), ("materials", 8)):
        stored = sum(path.stat().st_size for path in output.glob(f"*/{layer}/**/*") if path.is_file())
        rows.append(
            {
                "layer": layer,
                "raw": raw,
                "stored": round(stored / vertices, 3),
                "share": round(stored / report["bytes"], 3),
            }
        )
    shutil.rmtree(output)
    return report, rows


def _size(side: int, report: dict[str, Any]) -> Row:
    expected, vertices, seconds = report["estimate"], report["estimate"]["vertices"], report["seconds"]
    return {
        "side": side,
        "vertices": vertices,
        "million_vertices": round(vertices * 1e-6, 2),
        "seconds": seconds,
        "million_vertices_per_s": round(vertices * 1e-6 / seconds, 3),
        "megabytes": round(report["peak_memory"] * 1e-6, 1),
        "bytes_a_vertex": round(report["bytes"] / vertices, 3),
        "estimated_bytes": round(sum(expected["disk"]["parts"].values()) / report["bytes"], 3),
        "estimated_memory": round(expected["memory"]["needed"] / report["peak_memory"], 3),
    }


def _workers(folder: Path, effort: Effort, device: Sequence[str]) -> list[Row]:
    """Return how long one world takes alone and with workers, in turn."""
    variants = {"alone": [], **{f"{count}": ["--workers", str(count)] for count in effort.world_workers}}
    took: dict[str, list[float]] = {name: [] for name in variants}
    for _ in range(effort.world_rounds):
        for name, words in variants.items():
            report, _ = _world(folder, effort.world_workers_side, [*device, *words])
            took[name].append(report["seconds"])
    alone = np.array(took["alone"])
    return [
        {
            "workers": name if name == "alone" else f"{name} worker{'' if name == '1' else 's'}",
            "rounds_seconds": seconds,
            "seconds_each": round(float(np.median(seconds)), 3),
            "ratio": round(float(np.median(alone / np.array(seconds))), 3),
            "worst_ratio": round(float(np.min(alone / np.array(seconds))), 3),
        }
        for name, seconds in took.items()
    ]


_PANELS = [
    Curves("Time", "million_vertices", {"measured": "seconds"}, units=("million vertices, all levels", "s")),
    Curves(
        *("Memory", "million_vertices", {"most": "megabytes"}),
        units=("million vertices, all levels", "MB"),
        scales=("log", "linear"),
        asked=(2000.0,),
    ),
]
draw_worlds = partial(draw_curves, "Time and memory of a world by its area", _PANELS)
