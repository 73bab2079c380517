"""Ways to draw a view of the world, each with a setting that trades triangles for error."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from time import perf_counter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.benchmarks.baselines.problem import Absent
from sketchterrain.benchmarks.baselines.thesis import Sampling, ThesisTiles
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.flight_meshes import Mesh, Tiles, View, drawn, uniform_tiles
from sketchterrain.benchmarks.flight_peers import MESHERS, Mesher, Rasters, mesher
from sketchterrain.benchmarks.flight_scene import FINEST_CELL, OwnTiles, view_of, within_world
from sketchterrain.benchmarks.thesis_view import ThesisView, feature_discs
from sketchterrain.benchmarks.timing import lap
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.tiles.stream import QUADS

OURS = "this program"
THESIS = "the thesis's metric"
SAMPLING = Sampling(8, 3)
"""How the thesis's kernels look for the nearest place on a river: the cheapest that serves mountains well."""

_FACTOR = 2.0  # F near mountains and rivers
_APART = 2.0  # px between samples of heightmaps, at least
_BATCH = 64  # tiles of the uniform grid written at once


class Shown(NamedTuple):
    """What a way draws of a view."""

    meshes: Iterable[Mesh]
    triangles: int
    seconds: float
    whole: bool = True


@dataclass(frozen=True)
class Way:
    """A way to draw."""

    name: str
    unit: str
    settings: tuple[float, ...]
    draw: Callable[[View, float], Shown]


def ways(terrain: Terrain, effort: Effort) -> tuple[list[Way], list[Absent]]:
    """Return the ways, and the peers that are not on this machine."""
    found = [
        Way(f"{OURS}, {quads} quads", "τ = {:g} px", effort.flight_own_pixels, partial(_own, terrain, quads))
        for quads in effort.flight_own_quads
    ]
    found += [
        Way(
            f"{THESIS}, {quads} quads",
            "T = {:g}",
            effort.flight_tessellations,
            partial(_thesis, terrain, quads),
        )
        for quads in effort.flight_own_quads
    ]
    found.append(
        Way(
            "uniform grid",
            "{:g} m",
            tuple(terrain.extent / QUADS / 2**level for level in effort.flight_grid_levels),
            partial(_uniform, terrain),
        )
    )
    rasters = _RasterMemory(terrain, min(effort.flight_pixels))
    absent = []
    for name in MESHERS:
        peer = mesher(name)
        if isinstance(peer, Absent):
            absent.append(peer)
        else:
            found.append(Way(peer.name, "{:g} px", effort.flight_pixels, partial(rasters.draw, peer)))
    return found, absent


@lru_cache(maxsize=32)
def thesis_view(terrain: Terrain, quads: int, tessellation: float) -> ThesisView:
    """Return the thesis's metric over the world."""
    return ThesisView(
        terrain.extent, quads, tessellation, FINEST_CELL, feature_discs(terrain.recipe, _FACTOR)
    )


def thesis_seconds(terrain: Terrain, places: npt.NDArray[np.int64], quads: int) -> float:
    """Return what the thesis's kernels take for tiles (level, column, row): a launch of each a tile."""
    seconds = 0.0
    for level in np.unique(places[:, 0]):
        keys = [(int(a), int(b), int(c)) for a, b, c in places[places[:, 0] == level]]
        tiles = ThesisTiles(terrain.recipe, terrain.context, keys, quads=quads)
        seconds += lap(partial(tiles.launch, SAMPLING)).wall
    return seconds


def _own(terrain: Terrain, quads: int, view: View, tolerance: float) -> Shown:
    tiles = OwnTiles(terrain, quads=quads, tolerance=tolerance)
    frame = tiles.converge(view_of(view.stop, terrain.extent))
    seen = drawn(terrain, within_world(frame.draws, quads), view)
    return Shown(seen.meshes(), seen.triangles, frame.generation + frame.choice, tiles.whole)


def _thesis(terrain: Terrain, quads: int, view: View, tessellation: float) -> Shown:
    chosen = thesis_view(terrain, quads, tessellation).tiles(view.stop.camera.eye, view.stop.ground)
    rows = np.array(chosen, np.int64)
    seen = drawn(terrain, Tiles(quads, rows[:, :3], rows[:, 3]), view)
    return Shown(seen.meshes(), seen.triangles, thesis_seconds(terrain, seen.places, quads))


def _uniform(terrain: Terrain, view: View, cell: float) -> Shown:
    level = round(np.log2(terrain.extent / QUADS / cell))
    seen = drawn(terrain, uniform_tiles(terrain.extent, QUADS, level), view)
    store = terrain.vertex_store(_BATCH, quads=QUADS)
    start = perf_counter()
    for first in range(0, len(seen.places), _BATCH):
        keys = [(int(a), int(b), int(c)) for a, b, c in seen.places[first : first + _BATCH]]
        terrain.write_tiles(keys, np.arange(len(keys)), np.full(len(keys), -1), store)
    return Shown(seen.meshes(), seen.triangles, perf_counter() - start)


class _RasterMemory:
    """Keeps the heightmaps of the last views, which all meshers and errors share."""

    def __init__(self, terrain: Terrain, finest: float) -> None:
        self._terrain = terrain
        self._apart = max(_APART, finest / 2)
        self._known: dict[View, Rasters] = {}

    def draw(self, peer: Mesher, view: View, pixels: float) -> Shown:
        if view not in self._known:
            self._known[view] = Rasters(self._terrain, view, apart=self._apart)
        rasters = self._known[view]
        start = perf_counter()
        meshes: Sequence[Mesh] = [
            peer.mesh(square, rasters.allowed(square, pixels)) for square in rasters.squares
        ]
        seconds = perf_counter() - start + rasters.seconds
        return Shown(meshes, sum(len(mesh.triangles) for mesh in meshes), seconds)
