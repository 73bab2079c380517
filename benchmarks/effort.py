"""How much is measured: the sizes and rounds of a run."""

from dataclasses import dataclass

from sketchterrain.io.resources import preset_names
from sketchterrain.render.quality import PARTS


@dataclass(frozen=True)
class Effort:
    """Sizes of every benchmark."""

    rounds: int  # Measured rounds after one for warming up
    presets: tuple[str, ...]  # Presets whose features are placed and evaluated
    kernel_levels: tuple[int, ...]  # Tile levels at which kernels are timed
    kernel_tiles: int  # Tiles and single points a launch
    kernel_points: int
    noise_side: int  # Vertices along the side of the noise benchmark's grid
    thesis_tiles: int  # Tiles evaluated in the thesis's way
    spline_count: int  # Splines of each kind of trap
    culling_features: tuple[int, ...]  # Features in the worlds in which culling is measured
    point_side: float  # Side of the square of table 6.1 of the thesis, in the unit of its distances
    point_distances: tuple[int, ...]  # r and k of table 6.1 of the thesis
    point_trials: tuple[int, ...]
    room_side: float  # Side of the square whose room is measured, in distances
    room_trials: tuple[
        int, ...
    ]  # k at which the room that is left is measured: of this program and the thesis's way, of libraries
    peer_trials: tuple[int, ...]
    room_places: int  # Places drawn to see whether another point would fit there
    scipy_side: float  # Side of scipy's square, in distances
    point_sides: tuple[float, ...]  # Sides of squares with many points, in distances
    spectrum_sets: int  # Sets of points whose spectra are averaged
    accuracy_grounds: tuple[str, ...]  # Presets on which errors are measured
    accuracy_levels: tuple[int, ...]  # Tile levels, which set the cell size, at which errors are measured
    accuracy_tiles: int  # Tiles a level
    choice_tiles: int  # Tiles, a square number, on which other ways are compared
    flight_views: int  # Places of the flight at which errors are measured, and frames that are flown
    flight_frames: int
    flight_every: int  # Pixels between samples of a picture
    flight_size: tuple[int, int]  # Width and height of frames that are drawn, px
    flight_quads: tuple[
        int, ...
    ]  # Sizes of tiles that are flown with, and those of this program whose errors are measured
    flight_own_quads: tuple[int, ...]
    flight_pixels: tuple[float, ...]
    flight_tessellations: tuple[
        float, ...
    ]  # T of the thesis's metric at which errors are measured, and those that are flown with
    flight_own_pixels: tuple[
        float, ...
    ]  # τ at which errors are measured, px: of this program, which flies with them too; of the peers
    flight_factors: tuple[float, ...]
    flight_grid_levels: tuple[int, ...]  # Levels of the uniform grids
    picture_views: tuple[
        tuple[str, str], ...
    ]  # Preset and kind of view of the pictures; in the last one parts are left out
    picture_numbers: tuple[float, ...]  # Their qualities, besides the best
    picture_parts: tuple[str, ...]  # Parts that are left out in turn
    picture_rounds: int  # Measured rounds of each
    picture_size: tuple[int, int]  # Width and height of pictures, px
    live_strokes: int  # Strokes, and single dabs, that are painted while the terrain follows
    live_dabs: int
    batch_size: int  # Vertices along a side of a batch's terrains
    batch_files: tuple[str, ...]  # What is written of each
    batch_seeds: int  # Terrains of a batch, and those made one by one, in a round
    batch_fresh: int
    batch_jobs: tuple[int, ...]  # Terrains of a batch in work at once
    batch_rounds: int  # Measured rounds
    world_sides: tuple[int, ...]  # Vertices along a side of worlds that are written
    world_workers_side: int  # Vertices along a side of the world that workers share
    world_workers: tuple[int, ...]  # How many they are, besides none
    world_rounds: int  # Measured rounds of each


QUICK = Effort(
    rounds=3,
    presets=preset_names(),
    kernel_levels=(4, 8),
    kernel_tiles=8,
    kernel_points=1 << 14,
    noise_side=512,
    thesis_tiles=9,
    spline_count=24,
    culling_features=(100, 1_000, 10_000, 100_000),
    point_side=512.0,
    point_distances=(1, 2, 4, 8),
    point_trials=(4, 8, 12),
    room_side=128.0,
    room_trials=(1, 4, 12),
    peer_trials=(4, 30),
    room_places=100_000,
    scipy_side=16.0,
    point_sides=(512.0,),
    spectrum_sets=5,
    accuracy_grounds=("valley_river",),
    accuracy_levels=(2, 5, 8, 11),
    accuracy_tiles=2,
    choice_tiles=4,
    flight_views=1,
    flight_frames=10,
    flight_every=8,
    flight_size=(1280, 720),
    flight_quads=(64,),
    flight_own_quads=(64,),
    flight_pixels=(8.0, 4.0),
    flight_tessellations=(2.0, 6.0),
    flight_own_pixels=(8.0, 4.0),
    flight_factors=(2.0,),
    flight_grid_levels=(3, 4),
    picture_views=(("valley_river", "ground"),),
    picture_numbers=(0.1, 0.5),
    picture_parts=PARTS,
    picture_rounds=2,
    picture_size=(640, 360),
    live_strokes=3,
    live_dabs=6,
    batch_size=257,
    batch_files=("without preview",),
    batch_seeds=2,
    batch_fresh=1,
    batch_jobs=(2,),
    batch_rounds=1,
    world_sides=(513, 1025),
    world_workers_side=513,
    world_workers=(2,),
    world_rounds=1,
)
"""Under a minute on two shared cores."""

FULL = Effort(
    rounds=7,
    presets=preset_names(),
    kernel_levels=(3, 6, 9),
    kernel_tiles=64,
    kernel_points=1 << 18,
    noise_side=2048,
    thesis_tiles=256,
    spline_count=1737,
    culling_features=(100, 1_000, 10_000, 100_000, 1_000_000),
    point_side=512.0,
    point_distances=(1, 2, 4, 8),
    point_trials=(4, 8, 12),
    room_side=512.0,
    room_trials=(1, 2, 3, 4, 6, 8, 12, 16, 32, 64),
    peer_trials=(4, 12, 30),
    room_places=2_000_000,
    scipy_side=32.0,
    point_sides=(1024.0, 4096.0),
    spectrum_sets=20,
    accuracy_grounds=("valley_river", "desert_mountains"),
    accuracy_levels=(2, 4, 6, 8, 10, 12),
    accuracy_tiles=4,
    choice_tiles=16,
    flight_views=6,
    flight_frames=300,
    flight_every=4,
    flight_size=(1280, 720),
    flight_quads=(32, 64, 128, 256),
    flight_own_quads=(32, 64),
    flight_pixels=(4.0, 2.0, 1.0, 0.5),
    flight_tessellations=(1.0, 2.0, 4.0, 8.0),
    flight_own_pixels=(4.0, 2.0, 1.0),
    flight_factors=(2.0, 4.0, 6.0),
    flight_grid_levels=(2, 3, 4, 5),
    picture_views=(("valley_river", "auto"), ("valley_river", "ground")),
    picture_numbers=(0.0, 0.1, 0.25, 0.5, 0.75),
    picture_parts=PARTS,
    picture_rounds=3,
    picture_size=(1280, 720),
    live_strokes=60,
    live_dabs=120,
    batch_size=1025,
    batch_files=("all", "without preview"),
    batch_seeds=6,
    batch_fresh=2,
    batch_jobs=(1, 2),
    batch_rounds=2,
    world_sides=(1025, 2049, 4097, 8193, 16385, 32769),
    world_workers_side=8193,
    world_workers=(1, 2),
    world_rounds=3,
)
"""Minutes; what ``benchmarks/results/`` holds."""
