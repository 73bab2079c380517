"""Meshes of the ground: error against triangles and seconds, beside uniform grids of as many triangles."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.grounds import open_ground
from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import alternate, lap, spread
from sketchterrain.export.mesh import GridMesh, adaptive_mesh, full_mesh, mesh_error
from sketchterrain.export.sampled import SampleGrid, sample_terrain

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import Lap, TimedContext
    from sketchterrain.terrain.terrain import Terrain

_TITLE = "Meshes at an error bound"
_COLUMNS = (
    Column("ground", "ground"),
    Column("vertices", "vertices of the grid"),
    Column("asked", "error asked, m"),
    Column("error", "measured, m"),
    Column("triangles", "triangles"),
    Column("share", "of the grid's, %"),
    Column("rounds", "rounds"),
    Column("median_ms", "median, ms"),
    Column("p95_ms", "95 %, ms"),
    Column("check_ms", "of it measuring the error, ms"),
    Column("uniform_triangles", "uniform grid: triangles"),
    Column("uniform_error", "its error, m"),
    Column("uniform_over_it", "so many times as large"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Triangles and milliseconds that a mesh takes at an error bound, and the error of a uniform grid.

    The ground of each preset is sampled once; a mesh is then made of its heights by greedy insertion
    (pydelatin), its error measured in float64 at every vertex of the grid, both in the time; measuring alone
    is timed too. Times are the processor's: the work is one thread's, and other processes disturb it less so.
    Rounds alternate between all meshes. The uniform grid takes evenly spread rows and columns of the same
    vertices, as few as make no fewer triangles; its error is measured alike.
    """
    grounds = {name: _heights(open_ground(name, context), effort.mesh_side) for name in effort.presets}
    keys = [(name, error) for name in effort.presets for error in effort.mesh_errors]
    works: dict[tuple[str, float, str], Callable[[], Lap]] = {}
    made = {(name, error): adaptive_mesh(grounds[name], error) for name, error in keys}
    for name, error in keys:
        height = grounds[name]
        works[name, error, "mesh"] = partial(lap, partial(adaptive_mesh, height, error))
        works[name, error, "check"] = partial(lap, partial(mesh_error, made[name, error].mesh, height))
    laps = alternate(works, rounds=effort.mesh_rounds)
    rows: list[Row] = []
    for name, error in keys:
        height, mesh = grounds[name], made[name, error].mesh
        uniform = uniform_mesh(*height.shape, least=len(mesh.triangles))
        off = mesh_error(uniform, height)
        samples = [each.processor for each in laps[name, error, "mesh"]]
        times, check = spread(samples), spread([each.processor for each in laps[name, error, "check"]])
        rows.append(
            {
                "ground": name,
                "vertices": height.size,
                "asked": error,
                "error": made[name, error].error,
                "triangles": len(mesh.triangles),
                "share": 50.0 * len(mesh.triangles) / ((height.shape[0] - 1) * (height.shape[1] - 1)),
                "rounds": times.count,
                "median_ms": times.median * 1e3,
                "p95_ms": times.p95 * 1e3,
                "check_ms": check.median * 1e3,
                "uniform_triangles": len(uniform.triangles),
                "uniform_error": off,
                "uniform_over_it": off / made[name, error].error,
                "seconds": samples,
            }
        )
    return Outcome((Table(_TITLE, _COLUMNS, tuple(rows)),))


def uniform_mesh(rows: int, columns: int, *, least: int) -> GridMesh:
    """Return evenly spread rows and columns of a grid that make so many triangles or more, if it can."""
    shape, line = np.array([rows, columns]) - 1, 0
    while True:
        line += 1
        quads = np.minimum(np.ceil(shape * line / shape.max()), shape).astype(int)
        if 2 * quads.prod() >= least or line == shape.max():
            break
    mesh = full_mesh(int(quads[1]) + 1, int(quads[0]) + 1)
    row, column = (
        np.rint(np.linspace(0, each, count + 1)).astype(np.int32)
        for each, count in zip(shape, quads, strict=True)
    )
    return GridMesh(column[mesh.column], row[mesh.row], mesh.triangles)


def _heights(terrain: Terrain, side: int) -> npt.NDArray[np.float32]:
    east, north = terrain.size
    cell = max(east, north) / (side - 1)
    columns, rows = (max(round(length / cell), 1) + 1 for length in (east, north))
    return sample_terrain(terrain, SampleGrid(0.0, 0.0, east, north, columns, rows)).height
