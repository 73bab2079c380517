"""One device for all, and sizes that a test can afford."""

from dataclasses import replace

import pytest

from sketchterrain.benchmarks.effort import QUICK, Effort
from sketchterrain.benchmarks.timing import TimedContext

TINY = replace(
    QUICK,
    rounds=2,
    presets=("valley_river",),
    kernel_levels=(5,),
    kernel_tiles=1,
    kernel_points=64,
    noise_side=32,
    thesis_tiles=2,
    spline_count=2,
    culling_features=(30, 300),
    elevation_sides=(128,),
    point_side=24.0,
    point_distances=(1, 2),
    point_trials=(4,),
    room_side=24.0,
    room_trials=(1, 48),
    peer_trials=(4,),
    room_places=2_000,
    scipy_side=8.0,
    point_sides=(32.0,),
    spectrum_sets=2,
    accuracy_levels=(6, 9),
    accuracy_tiles=1,
    flight_views=2,
    flight_frames=3,
    flight_every=30,
    flight_quads=(32,),
    flight_own_quads=(32,),
    flight_pixels=(64.0, 16.0),
    flight_tessellations=(0.5, 1.0),
    flight_own_pixels=(64.0, 16.0),
    flight_factors=(0.5,),
    flight_grid_levels=(1, 2),
    picture_numbers=(0.1,),
    picture_parts=("water",),
    picture_size=(96, 54),
    view_sizes=((96, 54),),
    view_moments=(0.1, 0.2),
    view_frames=3,
    landform_presets=(),
    landform_nodes=(65,),
    landform_rounds=((2, 1, 1, 1),),
    landform_limits=(0.7,),
    landform_strokes=2,
    live_strokes=2,
    live_dabs=2,
    batch_size=17,
    batch_seeds=1,
    batch_jobs=(1,),
    batch_rounds=2,
    road_points=1_000,
    scale_sides=(8, 18),
    scale_edits=2,
    scale_frames=3,
    world_sides=(17, 33),
    world_workers_side=17,
    world_workers=(),
    world_rounds=2,
)


@pytest.fixture(scope="session")
def context() -> TimedContext:
    return TimedContext()


@pytest.fixture(scope="session")
def tiny() -> Effort:
    return TINY
