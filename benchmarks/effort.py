"""Problem sizes and rounds of a quick run and of a full one."""

from dataclasses import dataclass, field, fields
from typing import TypeVar

from sketchterrain.io.resources import preset_names
from sketchterrain.render.quality import PARTS

_Size = TypeVar("_Size")


def _sizes(quick: _Size, full: _Size) -> _Size:
    """Declare a size of quick and of full runs."""
    size: _Size = field(default=quick, metadata={"full": full})
    return size


@dataclass(frozen=True)
class Effort:
    """Sizes of every benchmark; the defaults take under a minute on two shared cores."""

    rounds: int = _sizes(3, 7)  # measured, after one that warms up
    presets: tuple[str, ...] = preset_names()  # whose features are placed and evaluated
    kernel_levels: tuple[int, ...] = _sizes((4, 8), (3, 6, 9))  # of tiles
    kernel_tiles: int = _sizes(8, 64)  # a launch
    kernel_points: int = _sizes(1 << 14, 1 << 18)  # a launch
    host_side: int = _sizes(129, 513)  # cells along a side of the samples of loops on the host
    noise_side: int = _sizes(512, 2048)  # vertices along a side of the grid
    thesis_tiles: int = _sizes(9, 256)  # evaluated by both methods
    spline_count: int = _sizes(24, 1737)  # of each kind
    # In a world
    culling_features: tuple[int, ...] = _sizes(
        (100, 1_000, 10_000, 100_000), (100, 1_000, 10_000, 100_000, 1_000_000)
    )
    # Table 6.1 of the thesis: side of the square, r and k
    point_side: float = 512.0
    point_distances: tuple[int, ...] = (1, 2, 4, 8)
    point_trials: tuple[int, ...] = (4, 8, 12)
    # Free area: sides of squares in distances, k of this program and the thesis, k of libraries, places
    room_side: float = _sizes(128.0, 512.0)
    room_trials: tuple[int, ...] = _sizes((1, 4, 12), (1, 2, 3, 4, 6, 8, 12, 16, 32, 64))
    peer_trials: tuple[int, ...] = _sizes((4, 30), (4, 12, 30))
    room_places: int = _sizes(100_000, 2_000_000)
    scipy_side: float = _sizes(16.0, 32.0)
    # Squares with many points, in distances
    point_sides: tuple[float, ...] = _sizes((512.0,), (1024.0, 4096.0))
    spectrum_sets: int = _sizes(5, 20)  # sets of points whose spectra are averaged
    accuracy_grounds: tuple[str, ...] = _sizes(
        ("valley_river", "relief of valley_river"),
        ("valley_river", "relief of valley_river", "desert_mountains"),
    )
    # Of tiles, which set the cell size
    accuracy_levels: tuple[int, ...] = _sizes((2, 5, 8, 11), (2, 4, 6, 8, 10, 12))
    accuracy_tiles: int = _sizes(2, 4)  # a level
    flight_views: int = _sizes(1, 6)  # at which errors are measured
    flight_frames: int = _sizes(10, 300)
    flight_every: int = _sizes(8, 4)  # px between samples of a picture
    flight_quads: tuple[int, ...] = _sizes((64,), (32, 64, 128, 256))  # along a tile, in flight
    flight_own_quads: tuple[int, ...] = _sizes((64,), (32, 64))  # along a tile, where errors are measured
    # Error of the heightmap meshers
    flight_pixels: tuple[float, ...] = _sizes((8.0, 4.0), (4.0, 2.0, 1.0, 0.5))
    flight_own_pixels: tuple[float, ...] = _sizes((8.0, 4.0), (4.0, 2.0, 1.0))  # τ of this program
    # T of the thesis where errors are measured
    flight_tessellations: tuple[float, ...] = _sizes((2.0, 6.0), (1.0, 2.0, 4.0, 8.0))
    flight_factors: tuple[float, ...] = _sizes((2.0,), (2.0, 4.0, 6.0))  # T of the thesis in flight
    flight_grid_levels: tuple[int, ...] = _sizes((3, 4), (2, 3, 4, 5))  # of the uniform grids
    # The last one without parts
    picture_views: tuple[tuple[str, str], ...] = _sizes(
        (("valley_river", "ground"),), (("valley_river", "auto"), ("valley_river", "ground"))
    )
    # Qualities besides the best
    picture_numbers: tuple[float, ...] = _sizes((0.1, 0.5), (0.0, 0.1, 0.25, 0.5, 0.75))
    picture_parts: tuple[str, ...] = PARTS  # omitted one at a time
    picture_rounds: int = _sizes(2, 3)
    picture_size: tuple[int, int] = _sizes((640, 360), (1280, 720))  # px
    # Whose window, flight and preview are timed
    view_presets: tuple[str, ...] = _sizes(
        ("valley_river",), ("valley_river", "alpine_range", "canyon_mesa", "island_coast")
    )
    # Px, in flight; of the window: the last one
    view_sizes: tuple[tuple[int, int], ...] = _sizes(((640, 360),), ((960, 600), (1280, 720)))
    # S of refinement, after which the camera turns
    view_moments: tuple[float, ...] = _sizes((0.5, 1.5), (0.5, 1.0, 1.5, 2.0, 3.0))
    view_frames: int = _sizes(20, 200)  # of the automatic flight
    view_places: int = _sizes(2, 5)  # of them are compared with stills
    landform_sketches: int = _sizes(1, 3)  # painted at random
    landform_presets: tuple[str, ...] = _sizes(("valley_river",), preset_names())
    landform_nodes: tuple[int, ...] = _sizes((65, 257), (65, 129, 257, 513))  # along the sketch's side
    landform_rounds: tuple[tuple[int, ...], ...] = _sizes(
        ((4, 2, 2, 2), (8, 3, 3, 3)),
        ((2, 1, 1, 1), (4, 2, 2, 2), (8, 3, 3, 3), (16, 6, 6, 6), (32, 12, 12, 12)),
    )
    landform_limits: tuple[float, ...] = _sizes((0.7, 1.33), (0.7, 1.0, 1.33, 2.4))  # of heights, inradii
    landform_strokes: int = _sizes(4, 100)
    live_strokes: int = _sizes(3, 60)
    live_drags: int = _sizes(2, 10)
    live_dabs: int = _sizes(6, 120)
    batch_size: int = _sizes(257, 1025)  # vertices along a side
    batch_files: tuple[str, ...] = _sizes(("without preview",), ("all", "without preview"))
    batch_seeds: int = _sizes(2, 6)  # terrains of a batch
    batch_fresh: int = _sizes(1, 2)  # terrains of single processes, in a round
    batch_jobs: tuple[int, ...] = _sizes((2,), (1, 2))
    batch_rounds: int = _sizes(1, 2)
    elevation_sides: tuple[int, ...] = _sizes((1024,), (1024, 4096, 16384))  # samples along a grid
    drape_features: int = _sizes(500, 10_000)  # of a layer whose coverage is exact
    drape_views: int = _sizes(1, 4)
    drape_vertices: int = _sizes(50_000, 4_942_539)
    drape_many: int = _sizes(10_000, 100_000)  # features that are picked and edited
    drape_picks: int = _sizes(200, 10_000)
    drape_edits: int = _sizes(3, 30)
    drape_frames: int = _sizes(2, 8)  # of slow motion
    road_points: int = _sizes(50_000, 1_000_000)  # of carriageways
    # Cells along a country of fields
    scale_sides: tuple[int, ...] = _sizes((18, 54), (18, 54, 110, 218, 436))
    scale_edits: int = _sizes(20, 1000)
    scale_frames: int = _sizes(30, 4380)  # of the flight
    # Vertices along a side
    world_sides: tuple[int, ...] = _sizes((513, 1025), (1025, 2049, 4097, 8193, 16385, 32769))
    world_workers_side: int = _sizes(513, 8193)  # of the world that workers share
    world_workers: tuple[int, ...] = _sizes((2,), (1, 2))
    world_rounds: int = _sizes(1, 3)


QUICK = Effort()

FULL = Effort(**{each.name: each.metadata["full"] for each in fields(Effort) if each.metadata})
"""Minutes; measured for ``benchmarks/results/``."""
