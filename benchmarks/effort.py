"""Problem sizes and rounds of a quick run and of a full one."""

from dataclasses import dataclass, replace

from sketchterrain.io.resources import preset_names
from sketchterrain.render.quality import PARTS


@dataclass(frozen=True)
class Effort:
    """Sizes of every benchmark; the defaults take under a minute on two shared cores."""

    rounds: int = 3  # measured, after one that warms up
    presets: tuple[str, ...] = preset_names()  # whose features are placed and evaluated
    kernel_levels: tuple[int, ...] = (4, 8)  # of tiles
    kernel_tiles: int = 8  # a launch
    kernel_points: int = 1 << 14  # a launch
    noise_side: int = 512  # vertices along a side of the grid
    thesis_tiles: int = 9  # evaluated by both methods
    spline_count: int = 24  # of each kind
    culling_features: tuple[int, ...] = (100, 1_000, 10_000, 100_000)  # in a world
    # Table 6.1 of the thesis: side of the square, r and k
    point_side: float = 512.0
    point_distances: tuple[int, ...] = (1, 2, 4, 8)
    point_trials: tuple[int, ...] = (4, 8, 12)
    # Free area: sides of squares in distances, k of this program and the thesis, k of libraries, places
    room_side: float = 128.0
    room_trials: tuple[int, ...] = (1, 4, 12)
    peer_trials: tuple[int, ...] = (4, 30)
    room_places: int = 100_000
    scipy_side: float = 16.0
    point_sides: tuple[float, ...] = (512.0,)  # squares with many points, in distances
    spectrum_sets: int = 5  # sets of points whose spectra are averaged
    accuracy_grounds: tuple[str, ...] = ("valley_river", "relief of valley_river")
    accuracy_levels: tuple[int, ...] = (2, 5, 8, 11)  # of tiles, which set the cell size
    accuracy_tiles: int = 2  # a level
    choice_tiles: int = 4  # a square number, on which alternative methods are compared
    flight_views: int = 1  # at which errors are measured
    flight_frames: int = 10
    flight_every: int = 8  # px between samples of a picture
    flight_quads: tuple[int, ...] = (64,)  # along a tile, in flight
    flight_own_quads: tuple[int, ...] = (64,)  # along a tile, where errors are measured
    flight_pixels: tuple[float, ...] = (8.0, 4.0)  # error of the heightmap meshers
    flight_own_pixels: tuple[float, ...] = (8.0, 4.0)  # τ of this program
    flight_tessellations: tuple[float, ...] = (2.0, 6.0)  # T of the thesis where errors are measured
    flight_factors: tuple[float, ...] = (2.0,)  # T of the thesis in flight
    flight_grid_levels: tuple[int, ...] = (3, 4)  # of the uniform grids
    picture_views: tuple[tuple[str, str], ...] = (("valley_river", "ground"),)  # the last one without parts
    picture_numbers: tuple[float, ...] = (0.1, 0.5)  # qualities besides the best
    picture_parts: tuple[str, ...] = PARTS  # omitted one at a time
    picture_rounds: int = 2
    picture_size: tuple[int, int] = (640, 360)  # px
    view_presets: tuple[str, ...] = ("valley_river",)  # whose window, flight and preview are timed
    view_sizes: tuple[tuple[int, int], ...] = ((640, 360),)  # px, in flight; of the window: the last one
    view_moments: tuple[float, ...] = (0.5, 1.5)  # s of refinement, after which the camera turns
    view_frames: int = 20  # of the automatic flight
    view_places: int = 2  # of them are compared with stills
    landform_sketches: int = 1  # painted at random
    landform_presets: tuple[str, ...] = ("valley_river",)
    landform_nodes: tuple[int, ...] = (65, 257)  # along the sketch's side
    landform_rounds: tuple[tuple[int, ...], ...] = ((4, 2, 2, 2), (8, 3, 3, 3))
    landform_limits: tuple[float, ...] = (0.7, 1.33)  # of heights, inradii
    landform_strokes: int = 4
    live_strokes: int = 3
    live_drags: int = 2
    live_dabs: int = 6
    batch_size: int = 257  # vertices along a side
    batch_files: tuple[str, ...] = ("without preview",)
    batch_seeds: int = 2  # terrains of a batch
    batch_fresh: int = 1  # terrains of single processes, in a round
    batch_jobs: tuple[int, ...] = (2,)
    batch_rounds: int = 1
    elevation_sides: tuple[int, ...] = (1024,)  # samples along a grid
    elevation_angles: tuple[float, ...] = (0.0, 30.0)  # degrees
    elevation_dems: int = 1  # real ones, of those there are
    detail_lattices: int = 4  # of octaves
    drape_features: int = 500  # of a layer whose coverage is exact
    drape_views: int = 1
    drape_vertices: int = 50_000
    drape_many: int = 10_000  # features that are picked and edited
    drape_picks: int = 200
    drape_edits: int = 3
    drape_frames: int = 2  # of slow motion
    road_points: int = 50_000  # of carriageways
    scale_sides: tuple[int, ...] = (18, 54)  # cells along a country of fields
    scale_pieces: tuple[int, ...] = (10, 32)  # the same, of the indices of pieces
    scale_views: int = 3  # places looked at
    scale_edits: int = 20
    scale_frames: int = 30  # of the flight
    world_sides: tuple[int, ...] = (513, 1025)  # vertices along a side
    world_workers_side: int = 513  # of the world that workers share
    world_workers: tuple[int, ...] = (2,)
    world_rounds: int = 1


QUICK = Effort()

FULL = replace(
    QUICK,
    rounds=7,
    kernel_levels=(3, 6, 9),
    kernel_tiles=64,
    kernel_points=1 << 18,
    noise_side=2048,
    thesis_tiles=256,
    spline_count=1737,
    culling_features=(100, 1_000, 10_000, 100_000, 1_000_000),
    room_side=512.0,
    room_trials=(1, 2, 3, 4, 6, 8, 12, 16, 32, 64),
    peer_trials=(4, 12, 30),
    room_places=2_000_000,
    scipy_side=32.0,
    point_sides=(1024.0, 4096.0),
    spectrum_sets=20,
    accuracy_grounds=("valley_river", "relief of valley_river", "desert_mountains"),
    accuracy_levels=(2, 4, 6, 8, 10, 12),
    accuracy_tiles=4,
    choice_tiles=16,
    flight_views=6,
    flight_frames=300,
    flight_every=4,
    flight_quads=(32, 64, 128, 256),
    flight_own_quads=(32, 64),
    flight_pixels=(4.0, 2.0, 1.0, 0.5),
    flight_tessellations=(1.0, 2.0, 4.0, 8.0),
    flight_own_pixels=(4.0, 2.0, 1.0),
    flight_factors=(2.0, 4.0, 6.0),
    flight_grid_levels=(2, 3, 4, 5),
    picture_views=(("valley_river", "auto"), ("valley_river", "ground")),
    picture_numbers=(0.0, 0.1, 0.25, 0.5, 0.75),
    picture_rounds=3,
    picture_size=(1280, 720),
    view_presets=("valley_river", "alpine_range", "canyon_mesa", "island_coast"),
    view_sizes=((960, 600), (1280, 720)),
    view_moments=(0.5, 1.0, 1.5, 2.0, 3.0),
    view_frames=200,
    view_places=5,
    landform_sketches=3,
    landform_presets=preset_names(),
    landform_nodes=(65, 129, 257, 513),
    landform_rounds=((2, 1, 1, 1), (4, 2, 2, 2), (8, 3, 3, 3), (16, 6, 6, 6), (32, 12, 12, 12)),
    landform_limits=(0.7, 1.0, 1.33, 2.4),
    landform_strokes=100,
    live_strokes=60,
    live_drags=10,
    live_dabs=120,
    batch_size=1025,
    batch_files=("all", "without preview"),
    batch_seeds=6,
    batch_fresh=2,
    batch_jobs=(1, 2),
    batch_rounds=2,
    elevation_sides=(1024, 4096, 16384),
    elevation_angles=(0.0, 10.0, 17.0, 30.0, 45.0),
    elevation_dems=4,
    drape_features=10_000,
    drape_views=4,
    drape_vertices=4_942_539,
    drape_many=100_000,
    drape_picks=10_000,
    drape_edits=30,
    drape_frames=8,
    road_points=1_000_000,
    scale_sides=(18, 54, 110, 218, 436),
    scale_pieces=(10, 32, 98, 218, 436),
    scale_views=20,
    scale_edits=1000,
    scale_frames=4380,
    world_sides=(1025, 2049, 4097, 8193, 16385, 32769),
    world_workers_side=8193,
    world_workers=(1, 2),
    world_rounds=3,
)
"""Minutes; measured for ``benchmarks/results/``."""
