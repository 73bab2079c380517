"""Parts of engine exports: axes, interpolated ground, weights, control maps, steps of heights."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes, path_of, storeys_of
from sketchterrain.export.height_steps import HeightSteps
from sketchterrain.export.sampled import Grid, Sampled, ground_at
from sketchterrain.export.target import Export, ExportOptions
from sketchterrain.export.tiling import Tiling
from sketchterrain.export.weights import control_map, edge_to_edge, normals_down

UNITY = EngineAxes("east", "up", "north")
UNREAL = EngineAxes("east", "south", "up", unit="cm", per_metre=100.0, origin=(10.0, 20.0, 0.0))
GODOT = EngineAxes("east", "up", "south")


def sampled(height: np.ndarray, spacing: float = 2.0) -> Sampled:
    rows, columns = height.shape
    grid = Grid(10.0, 20.0, 10.0 + spacing * (columns - 1), 20.0 + spacing * (rows - 1), columns, rows)
    up = np.broadcast_to(np.uint8([128, 128, 255]), (rows, columns, 3))
    return Sampled(grid, height.astype(np.float32), up, np.full((rows, columns, 1), 255, np.uint8))


def test_positions_and_rotations_in_the_axes_of_each_engine() -> None:
    """East turned a quarter counter-clockwise is north, whatever a program's rotation matrix looks like."""
    place = np.array([12.0]), np.array([25.0]), np.array([3.0])
    np.testing.assert_array_equal(UNITY.places(*place), [[12.0, 3.0, 25.0]])
    np.testing.assert_array_equal(UNREAL.places(*place), [[200.0, -500.0, 300.0]])
    np.testing.assert_array_equal(GODOT.places(*place), [[12.0, 3.0, -25.0]])

    for axes in [UNITY, UNREAL, GODOT]:
        quarter = axes.turn * np.pi / 2
        east, north = axes.directions(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
        c, s = np.cos(quarter), np.sin(quarter)
        # About Unity's and Godot's Y axis (one formula for either handedness) or Unreal's Z axis.
        about = {
            "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
            "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
        }["z" if axes.z == "up" else "y"]
        np.testing.assert_allclose(about @ east, north, atol=1e-12)
        assert axes.facts["handed"] == ("right" if axes is GODOT else "left"), axes


def test_ground_between_vertices_is_exact_on_a_plane_and_clamped_at_the_edge() -> None:
    row, column = np.mgrid[0:5, 0:7]
    plane = sampled(3.0 * column - 2.0 * row)
    random = np.random.default_rng(1)
    east, north = random.uniform(10.0, 22.0, 200), random.uniform(20.0, 28.0, 200)
    true = 3.0 * (east - 10.0) / 2.0 - 2.0 * (28.0 - north) / 2.0
    np.testing.assert_allclose(ground_at(plane, east, north), true, atol=1e-5)
    rough = sampled(random.normal(0.0, 50.0, (5, 7)))
    at = ground_at(rough, 10.0 + 2.0 * column.ravel(), 28.0 - 2.0 * row.ravel())
    np.testing.assert_array_equal(at, rough.height.ravel())

    ground = sampled(np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(ground_at(ground, np.array([0.0, 99.0]), np.array([99.0, 0.0])), [0.0, 5.0])


def test_resampled_weights_reach_the_edges_and_agree_between_tiles_and_normals_turn_green_alone() -> None:
    ramp = np.arange(33)
    weights = np.zeros((33, 33, 3), np.uint8)
    weights[..., 0] = np.rint(ramp * 255 / 32)[None]
    weights[..., 1] = 255 - weights[..., 0]
    small = edge_to_edge(weights)
    assert small.shape == (32, 32, 3)
    assert (small.sum(axis=-1, dtype=int) == 255).all()
    np.testing.assert_array_equal(small[0, :, 0], small[31, :, 0])
    assert np.abs(small[0, :, 0] - np.arange(32) * 255 / 31).max() <= 1.5  # two roundings
    np.testing.assert_array_equal(small[:, [0, -1]], weights[:32, [0, -1]])

    for seed in range(3):
        random = np.random.default_rng(seed)
        share = random.dirichlet([0.4] * 5, (65, 129)) * 255
        weights = np.floor(share).astype(np.uint8)
        weights[..., 0] += (255 - weights.sum(axis=-1, dtype=int)).astype(np.uint8)
        west, east = (edge_to_edge(weights[:, left : left + 65]) for left in (0, 64))
        np.testing.assert_array_equal(west[:, -1], east[:, 0])

    normal = np.uint8([[[10, 20, 30], [128, 255, 0]]])
    np.testing.assert_array_equal(normals_down(normal), [[[10, 235, 30], [128, 0, 0]]])
    np.testing.assert_array_equal(normals_down(normals_down(normal)), normal)


def test_bits_of_the_control_map_are_finite_floats() -> None:
    weights = np.uint8([[[255, 0, 0], [0, 200, 55], [128, 127, 0], [85, 85, 85]]])
    bits = control_map(weights).view(np.uint32)[0].tolist()
    fields = [(b >> 27, b >> 22 & 0x1F, b >> 14 & 0xFF, b & 0x3FFF) for b in bits]
    assert fields == [(0, 0, 0, 0), (1, 2, 55, 0), (0, 1, 127, 0), (0, 1, 128, 0)]

    weights = np.zeros((1, 30 * 30, 30), np.uint8)
    pairs = [(a, b) for a in range(30) for b in range(30) if a != b]
    for i, (a, b) in enumerate(pairs):
        weights[0, i, a], weights[0, i, b] = 128, 127
    assert np.isfinite(control_map(weights[:, : len(pairs)])).all()
    with pytest.raises(InputError, match="30 materials, got 31"):
        control_map(np.zeros((1, 1, 31), np.uint8))


def test_storeys_and_file_names_follow_the_options(tmp_path: Path) -> None:
    assert storeys_of(ExportOptions()) == {"woody": "plants"}
    assert storeys_of(ExportOptions(grass=True)) == {"woody": "plants", "grass": "grass"}
    assert storeys_of(ExportOptions(plants=False)) == {}

    for tiling, what, name in [
        (Tiling(), "height", "hill_height.png"),
        (Tiling(), "", "hill.png"),
        (Tiling(2, 2), "height", "hill_height_x1_y0.png"),
        (Tiling(2, 2, pattern="{x}_{y}"), "height", "height_1_0.png"),
        (Tiling(2, 2, pattern="{x}_{y}"), "", "1_0.png"),
    ]:
        ground = sampled(np.zeros((5, 5)))
        export = Export(None, "hill", ExportOptions(), ground.grid, tiling, ground, tmp_path, None)  # type: ignore[arg-type]
        piece = list(tiling.pieces(5, 5))[tiling.columns - 1]
        assert path_of(export, what, piece, ".png") == tmp_path / name, name


METRES = some.floats(-12_000.0, 12_000.0, width=32)


def decoded(steps: HeightSteps, numbers: np.ndarray) -> np.ndarray:
    return steps.low + numbers.astype(np.float64) * steps.range / 65536.0


@settings(deadline=None)
@given(some.lists(METRES, min_size=1, max_size=9))
def test_heights_round_trip_within_half_a_step(heights: list[float]) -> None:
    height = np.array([heights], np.float32)
    steps = HeightSteps.of(height)
    numbers = steps.encode(height)
    assert numbers.dtype == np.uint16
    off = np.abs(decoded(steps, numbers) - height.astype(np.float64))
    assert off.max() <= 0.5 * steps.step * (1.0 + 1e-9)
    assert steps.range <= max(1.0, float(np.ptp(height.astype(np.float64))) * 65536 / 65535 + 0.0025)


@settings(deadline=None)
@given(METRES, METRES)
def test_low_and_range_are_whole_millimetres(one: float, other: float) -> None:
    steps = HeightSteps.of(np.array([[one, other]], np.float32))
    for each in (steps.low, steps.range):
        assert float(f"{each:.3f}") == each


def test_the_whole_range_of_numbers_is_used_and_what_lies_outside_is_refused() -> None:
    numbers = HeightSteps.of(np.array([[0.0, 1000.0]], np.float32)).encode(
        np.array([[0.0, 1000.0]], np.float32)
    )
    assert numbers[0, 0] == 0
    assert numbers[0, 1] >= 65534

    height = np.full((3, 3), 812.5, np.float32)
    steps = HeightSteps.of(height)
    assert (steps.low, steps.range) == (812.5, 1.0)
    assert (steps.encode(height) == 0).all()

    steps = HeightSteps.of(np.array([[10.0, 20.0]], np.float32), (-100.0, 900.0))
    assert (steps.low, steps.range) == (-100.0, 1000.0)
    assert steps.step == 1000.0 / 65536.0
    assert steps.highest == pytest.approx(900.0 - steps.step)

    for wanted in [(0.0, 500.0), (11.0, 1000.0), (10.0, 999.98)]:
        with pytest.raises(InputError, match=r"the terrain goes from 10\.00 to 1000\.00 m"):
            HeightSteps.of(np.array([[10.0, 1000.0]], np.float32), wanted)

    for wanted in [(5.0, 5.0), (5.0, 4.0), (float("nan"), 1.0), (0.0, float("inf"))]:
        with pytest.raises(InputError, match="expected the lowest and the highest"):
            HeightSteps.of(np.zeros((2, 2), np.float32), wanted)

    steps = HeightSteps(0.0, 100.0)
    for outside in (-0.01, 100.0):
        with pytest.raises(InputError, match="do not fit"):
            steps.encode(np.array([[outside]], np.float32))
