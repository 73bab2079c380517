"""Flights: motion, files, automatic tours, captured frames."""

import dataclasses
import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera
from sketchterrain.render import views as tour_module
from sketchterrain.render.flight import (
    HEIGHTS,
    KEYFRAME,
    Flight,
    Keyframe,
    flight_text,
    load_flight,
    parse_flight,
    save_flight,
)
from sketchterrain.render.offscreen import capture_frames, render_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import find_sun
from sketchterrain.render.views import tour

from .test_camera import hills


def random_flight(seed, keys=12, **options):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.2, 3.0, keys))
    eyes = rng.uniform(-400.0, 400.0, (keys, 3))
    targets = eyes + rng.normal(0.0, 100.0, (keys, 3))
    fovs = rng.uniform(20.0, 80.0, keys)
    rows = zip(times, eyes.tolist(), targets.tolist(), fovs, strict=True)
    return Flight(tuple(Keyframe(float(t), tuple(e), tuple(a), float(f)) for t, e, a, f in rows), **options)


def circle(radius=300.0, keys=24, seconds=24.0):
    """A circle around a target at constant speed."""
    angles = np.linspace(0.0, 2 * np.pi, keys + 1)
    return Flight(
        tuple(
            Keyframe(seconds * i / keys, (radius * np.sin(a), radius * np.cos(a), 100.0), (0.0, 0.0, 0.0))
            for i, a in enumerate(angles.tolist())
        )
    )


def test_a_flight_passes_its_keyframes_with_continuous_motion():
    for seed in range(4):
        flight = random_flight(seed)
        times = [key.time - flight.keys[0].time for key in flight.keys]
        views = flight.at(times)
        for key, eye, target, fov in zip(flight.keys, views.eye, views.target, views.fov, strict=True):
            assert eye == pytest.approx(key.eye, abs=1e-6), seed
            assert target == pytest.approx(key.target, abs=1e-5), seed
            assert fov == pytest.approx(key.fov), seed

    for seed in range(3):
        flight = random_flight(seed)
        times = np.linspace(0.0, flight.duration, 16_001)
        views = flight.at(times)
        travelled = np.cumsum(
            0.5 * (views.velocity[1:] + views.velocity[:-1]) * np.diff(times)[:, None], axis=0
        )
        length = np.linalg.norm(np.diff(views.eye, axis=0), axis=1).sum()
        assert np.abs(views.eye[0] + travelled - views.eye[1:]).max() < 1e-4 * length, seed

    # Halving the step halves the changes of position, direction and velocity.
    for seed in range(2):
        flight = random_flight(seed)

        def greatest(step, flight=flight):
            views = flight.at(np.arange(0.0, flight.duration, step))
            forward = views.target - views.eye
            forward /= np.linalg.norm(forward, axis=1, keepdims=True)
            parts = (views.eye, forward, views.velocity[1:-1])
            return np.array([np.linalg.norm(np.diff(part, axis=0), axis=1).max() for part in parts])

        coarse, fine = greatest(0.0005), greatest(0.00025)
        assert (fine < 0.6 * coarse).all(), seed


def test_turns_take_the_shorter_arc_and_keep_the_heading_when_looking_down():
    keys = [
        Keyframe(t, (0, 0, 0), (np.sin(h), np.cos(h), 0)) for t, h in enumerate(np.radians([350.0, 10.0]))
    ]
    forward = Flight(tuple(keys)).at(0.5).target[0]
    assert forward == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)

    targets = [(0, 0, -9), (50, 0, 0), (0, 0, -9), (0, 0, 9)]
    keys = [Keyframe(t, (0, 0, 0), target) for t, target in enumerate(targets)]
    views = Flight(tuple(keys)).at(np.linspace(0.0, 2.9, 30))
    assert np.abs(views.target[:, 1]).max() < 1e-6
    assert (views.target[:, 0] > -1e-6).all()


def test_a_camera_that_halts_or_turns_in_place_does_not_move():
    places = [(0, 0, 5), (100, 0, 5), (100, 0, 5), (200, 50, 5)]
    keys = [Keyframe(2 * i, place, (place[0], 300, 0)) for i, place in enumerate(places)]
    views = Flight(tuple(keys)).at(np.linspace(2.0, 4.0, 50))
    assert (views.eye == (100.0, 0.0, 5.0)).all()
    assert np.abs(views.velocity[1:-1]).max() == 0.0
    keys = [Keyframe(t, (1e6, 1e6, 5), (1e6 + x, 1e6, 0)) for t, x in enumerate((1.0, -1.0, 1.0))]
    views = Flight(tuple(keys)).at(np.linspace(0.0, 2.0, 50))
    assert (views.eye == (1e6, 1e6, 5.0)).all()
    assert np.isfinite(views.target).all()
    # Nearly equal positions are one.
    keys = [Keyframe(t, (1e8 + 1e-5 * t, 0, 5), (1e8, 300, 0)) for t in range(5)]
    views = Flight(tuple(keys)).at(np.linspace(0.0, 4.0, 9))
    assert all(np.isfinite(part).all() for part in views)
    assert all((a == b).all() for a, b in itertools.pairwise(views.eye))


def test_frame_times_are_equidistant():
    flight = circle(seconds=10.0)
    assert flight.times(25) == pytest.approx(np.arange(250) / 25)
    assert flight.times(25, 2.0) == pytest.approx(np.arange(50) / 25)
    assert len(flight.times(25, 100.0)) == 250
    assert flight.times(0.001) == pytest.approx([0.0])


def test_heights_above_ground_follow_the_terrain():
    for seed in range(4):
        flight = random_flight(seed, heights="above ground").with_absolute_heights(hills, clearance=3.0)
        assert flight.heights == "absolute"
        eye = flight.at(np.linspace(0.0, flight.duration, 20_000)).eye
        assert (eye[:, 2] - hills(eye[:, 0], eye[:, 1])).min() > 2.9, seed

    keys = tuple(Keyframe(t, (90.0 * t, 0.0, 20.0), (90.0 * t, 50.0, 1.0)) for t in range(4))
    flight = Flight(keys, "above ground").with_absolute_heights(lambda x, y: np.full(np.shape(x), 700.0))
    assert [key.eye[2] for key in flight.keys] == [720.0] * 4
    assert [key.target[2] for key in flight.keys] == [701.0] * 4
    assert flight.with_absolute_heights(hills) is flight


TWO = """
[[key]]
time = 0
eye = [0, 0, 10]
target = [0, 100, 0]
[[key]]
time = 4.5
eye = [50, 0, 10]
target = [50, 100, 0]
"""


def test_flight_files_round_trip_with_documented_defaults(tmp_path):
    for seed, heights in enumerate(("absolute", "above ground")):
        flight = random_flight(seed, heights=heights)
        path = save_flight(flight, tmp_path / "a.toml")
        assert load_flight(path) == flight
        assert save_flight(load_flight(path), tmp_path / "b.toml").read_bytes() == path.read_bytes()
    text = flight_text(circle(keys=2))
    assert text.startswith("# The flight of a camera")
    assert text.count("[[key]]") == 3
    assert "z up. heights is the reference of heights (z)" in text.replace("\n# ", " ")

    flight = parse_flight(f"format = 1\n{TWO}".encode())
    assert (flight.heights, flight.duration, flight.keys[0].fov) == ("absolute", 4.5, 50.0)
    assert isinstance(flight.keys[0].eye[0], float)

    page = (Path(__file__).parents[2] / "docs/flying.md").read_text(encoding="utf-8")
    for name, key in KEYFRAME.items():
        assert f"| `{name}` | {key.range} {key.unit} | {key.help}" in page
    assert f"`heights` is the {HEIGHTS.help}" in " ".join(page.split())
    (example,) = re.findall(r"```toml\n(.*?)```", page, re.S)
    flight = parse_flight(example.encode())
    assert (flight.heights, flight.duration, flight.keys[1].fov) == (
        "above ground",
        8.0,
        KEYFRAME["fov"].default,
    )


TWO_KEYS = "format = 1" + TWO
WRONG = {
    "": "format = 1 expected, got no such key",
    "format = 2": "format = 1 expected, got 2",
    "format = true": "format = 1 expected, got true",
    "format = 1": "0 keys: expected two or more",
    "format = 1\nspeed = 3": "unknown key 'speed' = 3: expected format, heights, key",
    "format = 1\nheight = 'absolute'": "did you mean 'heights'?",
    "format = 1\nheights = 'sea'" + TWO: "heights = 'sea': expected 'absolute' or 'above ground'",
    "format = 1\nkey = 3": "key = 3: expected tables, each with [[key]]",
    "format = 1\n[[key]]\neye = [0, 0, 0]\ntarget = [1, 0, 0]": "[[key]] number 1: no time: expected time,",
    TWO_KEYS + "fovv = 3": "number 2: unknown key 'fovv' = 3: expected time, eye, target, fov; did you",
    TWO_KEYS + "fov = 200": "[[key]] number 2: fov = 200: expected a number from 5 to 120 °",
    TWO_KEYS.replace("4.5", "nan"): "[[key]] number 2: time = nan: expected a number",
    TWO_KEYS.replace("4.5", "0"): "key 2: time = 0.0: expected 0.001 s or more after the key before",
    TWO_KEYS.replace("[50, 0, 10]", "[50, 0]"): "eye = [50, 0]: expected three numbers, x, y and z",
    TWO_KEYS.replace("[50, 0, 10]", "[50, 0, 'a']"): "eye z = 'a': expected a number from",
    TWO_KEYS.replace("[50, 0, 10]", "[50, 100, 0]"): "expected another point than the eye",
    "format = = 1": "not TOML",
}


def test_invalid_files_are_refused_with_file_key_and_value(tmp_path):
    path = tmp_path / "wrong.toml"
    for text, message in WRONG.items():
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError) as error:
            load_flight(path)
        assert str(error.value).startswith(f"{path}: "), text
        assert message in str(error.value), text
        assert "\n" not in str(error.value), text
    path.write_bytes(b"\xff\xfe\x00")
    for name, message in (
        ("missing", "cannot be read"),
        (".", "cannot be read"),
        (path.name, "is not UTF-8"),
    ):
        with pytest.raises(InputError, match=message):
            load_flight(tmp_path / name)


def test_a_tour_stays_low_at_constant_speed_with_slow_turns(waves):
    for rivers in (waves.features.rivers, ()):
        waves.features.rivers = rivers
        flight = tour(waves, seconds=60.0)
        views = flight.at(flight.times(120))
        rise = tour_module.RISE * waves.extent
        clearance = views.eye[:, 2] - waves.heights(views.eye[:, 0], views.eye[:, 1])
        assert clearance.min() > 0.9 * tour_module.LOW * rise
        assert clearance.mean() < 3.0 * rise
        assert (views.eye[:, :2] > 0.0).all()
        assert (views.eye[:, :2] < waves.size).all()
        views = flight.at(flight.times(30))
        speed = np.linalg.norm(views.velocity, axis=1)
        assert speed.max() < 1.3 * speed.min()
        along = views.target - views.eye
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        turns = np.degrees(np.arccos(np.clip((along[1:] * along[:-1]).sum(axis=1), -1, 1))) * 30
        assert turns.max() < 40.0  # degrees a second, on so small a sketch


def test_a_tour_has_the_requested_duration_is_deterministic_closed_and_near_water(waves):
    flight = tour(waves, seconds=20.0)
    assert 20.0 <= flight.duration < 20.0 + 5 * tour_module.KEY_EVERY
    assert tour(waves, seconds=20.0) == flight
    lap = tour(waves, seconds=600.0)
    assert lap.at(flight.times(30, 20.0)).eye == pytest.approx(
        flight.at(flight.times(30, 20.0)).eye, abs=1e-3
    )
    eyes = lap.at(lap.times(1)).eye
    again = np.linalg.norm(eyes[60:] - eyes[0], axis=1)
    assert again.min() < 25.0

    # On average the loop is nearer to the river at y = 500 than without it.
    with_river = tour(waves, seconds=150.0)
    waves.features.rivers = ()
    without = tour(waves, seconds=150.0)
    distances = [np.abs(f.at(f.times(2)).eye[:, 1] - 500.0).mean() for f in (with_river, without)]
    assert distances[0] < distances[1]


def test_the_cheapest_loop_equals_brute_force():
    rng = np.random.default_rng(2)
    for _ in range(10):
        costs = rng.uniform(0.0, 1.0, (6, 4))
        paths = np.stack(np.meshgrid(*[np.arange(4)] * 6, indexing="ij"), axis=-1).reshape(-1, 6)
        steps = np.abs(paths - np.roll(paths, 1, axis=1))
        total = costs[np.arange(6), paths].sum(axis=1) + tour_module._STAY * steps.sum(axis=1)
        total[(steps > 1).any(axis=1)] = np.inf
        found = tour_module._cheapest(costs)
        assert tuple(found) == tuple(paths[np.argmin(total)])


SIZE = (96, 54)
QUICK = dataclasses.replace(Quality.from_level(0.25), map_texels=128, material_texels=128, quads=64)
WHOLE = Quality(samples=1, map_texels=128, material_texels=128, shade_texels=256, tile_memory=64 << 20)


@pytest.fixture
def views():
    """Four frames with a cut to the other end of the sketch in the middle."""
    keys = [Keyframe(t, (500.0, 100.0 + 60.0 * t, 140.0), (520.0, 500.0 + 60.0 * t, 30.0)) for t in range(3)]
    keys += [Keyframe(2.001 + t, (200.0 + 50.0 * t, 900.0, 160.0), (300.0, 400.0, 30.0)) for t in range(3)]
    return Flight(tuple(keys)).at([0.0, 2.0, 2.001, 3.0])


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("quality", [QUICK, WHOLE], ids=["quick", "whole"])
def test_a_complete_frame_equals_the_picture_of_its_camera(waves, views, quality):
    # A frame rate at which the water does not move.
    frames = list(capture_frames(waves, views, fps=1e9, size=SIZE, quality=quality))
    cameras = [
        Camera(tuple(eye), tuple(target), fov=fov)
        for eye, target, fov in zip(*(part.tolist() for part in views[:3]), strict=True)
    ]
    sun = find_sun(waves, cameras[0])
    for number in (1, 2):
        shot, picture = frames[number]
        alone = render_picture(waves, size=SIZE, camera=cameras[number], sun=sun, quality=quality)
        np.testing.assert_array_equal(picture, alone)
        assert shot.converged
    assert all(shot.triangles > 1000 and shot.tiles_drawn > 0 for shot, _ in frames)
    assert frames[0][0].tiles_generated > frames[1][0].tiles_generated
    assert all(0.0 < shot.generation_seconds < shot.seconds for shot, _ in frames)


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.usefixtures("gl")
def test_incomplete_frames_are_never_empty(waves, views):
    frames = list(capture_frames(waves, views, fps=30.0, size=SIZE, complete=False, quality=QUICK))
    assert all(shot.tiles_drawn > 0 and shot.triangles > 0 for shot, _ in frames)
    assert all(shot.seconds > 0.0 for shot, _ in frames)
    assert all(np.abs(a[1].astype(int) - b[1]).mean() > 0.5 for a, b in itertools.pairwise(frames))
    shots = list(
        capture_frames(waves, views, fps=30.0, size=SIZE, quality=QUICK, complete=False, pixels=False)
    )
    assert [picture for _, picture in shots] == [None] * 4
    with pytest.raises(InputError, match="8192"):
        next(capture_frames(waves, views, fps=30.0, size=(9000, 10)))
