"""`fly`: atomic films along the path, and their frame statistics."""

import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import sketchterrain.jobs.pictures
from sketchterrain.render.flight import Flight, Keyframe, save_flight
from sketchterrain.render.offscreen import CapturedFrame
from sketchterrain.render.quality import Quality

SMALL = ["--size", "64x48"]


@pytest.fixture
def path(tmp_path) -> Path:
    """Two seconds straight north, 80 m above the ground."""
    keys = [Keyframe(t, (100.0, 50.0 + 40.0 * t, 80.0), (100.0, 300.0 + 40.0 * t, 10.0)) for t in range(3)]
    return save_flight(Flight(tuple(keys), "above ground"), tmp_path / "flight.toml")


@pytest.fixture
def captures(monkeypatch) -> list[dict[str, Any]]:
    """Options of each call of a stub of `capture_frames`; frame n is 9n grey and takes n + 1 ms."""
    calls: list[dict[str, Any]] = []

    def capture_frames(terrain: object, views: Any, **options: Any) -> Iterator[Any]:
        calls.append(options | {"terrain": terrain, "views": views, "drawn": 0})
        for number in range(len(views.eye)):
            calls[-1]["drawn"] += 1
            shot = CapturedFrame(
                (number + 1) / 1000, number / 1000, int(number != 3), 10, 100 * number, number > 0
            )
            width, height = options["size"]
            yield shot, np.full((height, width, 3), 9 * number, np.uint8) if options["pixels"] else None

    monkeypatch.setattr(sketchterrain.jobs.pictures, "capture_frames", capture_frames)
    return calls


def test_frames_of_a_path(call, sketch, path, tmp_path, captures):
    out = tmp_path / "new" / "frames"
    done = call("fly", sketch, "--path", path, "-o", out, "--fps", 5, *SMALL)
    assert done.code == 0, done.err
    assert "North-east, seed 5: 10 frames of 64 × 48 pixels, 2 s at 5 a second" in done.out
    assert "181.8 frames a second, 5.5 ms a frame, 10.0 ms at most; 9 of 10 complete" in done.out
    assert done.out.endswith(f"film: {out}\n")
    assert sorted(each.name for each in out.iterdir()) == [f"{number:04d}.png" for number in range(10)]
    with Image.open(out / "0007.png") as image:
        assert (image.size, image.getpixel((0, 0))) == ((64, 48), (63, 63, 63))
    (shot,) = captures
    given = [shot[name] for name in ("fps", "size", "complete", "quality")]
    assert given == [5, (64, 48), True, None]
    eye, terrain = shot["views"].eye, shot["terrain"]
    assert eye[::5, 1] == pytest.approx([50.0, 90.0], abs=1e-3)  # at keyframes
    assert np.diff(eye[:, 1]) == pytest.approx(8.0, rel=1e-3)  # along a line that rises with the ground
    assert eye[0, 2] == pytest.approx(80.0 + float(terrain.heights(100.0, 50.0)), abs=1e-3)


def test_statistics_are_those_of_the_frames(call, sketch, path, captures):
    done = call("fly", sketch, "--path", path, "--fps", 5, "--seconds", 1, *SMALL, "--json")
    assert done.code == 0, done.err
    data = json.loads(done.out)
    assert (data["frames"], data["seconds"], data["settled"], data["output"]) == (5, 1.0, 4, None)
    assert data["frame"] == pytest.approx({"mean": 0.003, "worst": 0.005})
    assert data["frames_per_second"] == pytest.approx(5 / 0.015)
    assert data["triangles"] == {"mean": 200.0, "most": 400}
    # The first frame is initial, the fourth got no tile.
    expected = {"initial": 0.0, "updating_frames": 3, "mean": 0.007 / 3, "worst": 0.004, "tiles": 4}
    assert data["generation"] == pytest.approx(expected)
    assert (data["path"], data["seed"], data["real_time"]) == (str(path), 5, False)
    assert data["lowest"] == pytest.approx(80.0, abs=15.0)
    assert not captures[0]["pixels"]


def test_default_path_is_a_tour_of_the_sketch(call, sketch, captures):
    data = json.loads(call("fly", sketch, "--fps", 2, *SMALL, "--json").out)
    assert (data["path"], data["frames"], data["seconds"]) == (None, 40, 20.0)
    assert data["lowest"] > 5.0
    eye = captures[0]["views"].eye
    assert (eye[:, :2] > 0.0).all()
    assert (eye[:, :2] < (512.0, 384.0)).all()
    call("fly", sketch, "--fps", 2, "--seconds", 3, *SMALL)
    np.testing.assert_allclose(captures[1]["views"].eye, eye[:6], atol=1e-3)


def test_quality_real_time_and_a_path_under_the_ground(call, sketch, path, tmp_path, captures):
    more = ["--path", path, "--fps", 1, *SMALL]
    assert call("fly", sketch, *more, "--quality", 0.25).code == 0
    assert call("fly", sketch, *more, "--real-time").code == 0
    found = [(each["quality"], each["complete"]) for each in captures]
    assert found == [(Quality.from_level(0.25), True), (None, False)]

    keys = tuple(Keyframe(t, (50.0 * t, 0.0, -500.0), (50.0 * t, 9.0, -500.0)) for t in range(2))
    deep = save_flight(Flight(keys), tmp_path / "deep.toml")
    done = call("fly", sketch, "--path", deep, "--fps", 2, *SMALL)
    assert (done.code, "note: the path is up to 5" in done.out) == (0, True)
    assert captures[2]["views"].eye[0, 2] == -500.0


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.parametrize("more", [[], ["--real-time"]], ids=["complete", "real time"])
def test_rendered_flight(call, sketch, path, tmp_path, more):
    out = tmp_path / "frames"
    size = ["--size", "96x64", "--fps", 2, "--seconds", 1.5, "--quality", 0.2]
    done = call("fly", sketch, "--path", path, "-o", out, *size, "--json", *more)
    assert done.code == 0, done.err
    data = json.loads(done.out)
    assert data["frames"] == 3
    assert data["real_time"] == bool(more)
    assert 0 < data["frame"]["mean"] <= data["frame"]["worst"]
    pictures = [np.asarray(Image.open(out / f"000{number}.png")).astype(int) for number in range(3)]
    assert all(picture.shape == (64, 96, 3) and picture.std() > 10 for picture in pictures)
    assert all(np.abs(a - b).mean() > 0.5 for a, b in itertools.pairwise(pictures))
