"""Images, numbers and films of exports."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as some
from PIL import Image, ImageSequence

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export.film import ANIMATED, VIDEO, check_film, film
from sketchterrain.export.measured_maps import _hillshade
from sketchterrain.export.planning import HeightQuantisation
from sketchterrain.export.rasters import write_height_png, write_height_tif, write_materials, write_normal_png
from sketchterrain.export.sampled import control_map, quantise_weights, splat_weights
from sketchterrain.terrain.surfaces import Raster
from tests.refusals import refused

CHANNELS = ("red", "green", "blue", "alpha")


def ground(height):
    """Return a raster of given heights, 2 m apart eastward and 3 m northward, all of one material."""
    heights = np.asarray(height, np.float32)
    up = np.broadcast_to(np.float32([0, 0, 1]), (*heights.shape, 3))
    return Raster((2.0, 3.0), heights, up, np.broadcast_to(np.float32([1, 0, 0, 0]), (*heights.shape, 4)))


def read(path):
    with Image.open(path) as image:
        return np.asarray(image)


def decoded(tmp_path, raster):
    image, meaning = write_height_png(tmp_path, raster)
    content = json.loads(meaning.read_text(encoding="utf-8"))
    value = read(image)
    assert value.dtype == np.uint16
    return content["minimum"] + value * content["metres_per_step"], content


def test_height_png_round_trips_within_half_a_step(tmp_path, terrain, raster):
    height, content = decoded(tmp_path, raster)
    np.testing.assert_allclose(height, raster.height, rtol=0, atol=0.5001 * content["metres_per_step"])
    assert (content["minimum"], content["maximum"]) == (raster.height.min(), raster.height.max())
    value = read(tmp_path / "height.png")
    assert (value.min(), value.max()) == (0, 65535)
    east, north = terrain.size
    assert content["bounds"] == {"west": 0.0, "south": 0.0, "east": east, "north": north}
    assert content["spacing"] == {"x": raster.spacing[0], "y": raster.spacing[1]}
    assert (content["height"], content["width"]) == raster.height.shape
    assert content["orientation"] == {"row_0": "north", "column_0": "west", "samples": "vertices"}
    assert (content["units"], content["file"]) == ("m", "height.png")

    for level in [0.0, -17.25, 8000.0]:
        height, content = decoded(tmp_path, ground(np.full((4, 6), level)))
        assert content["metres_per_step"] == 0, level
        np.testing.assert_array_equal(height, level)
    low = np.float32(1e-45)  # the smallest float32: a 65535th of it is no float32
    height, _ = decoded(tmp_path, ground([[0.0, low], [low, 0.0]]))
    np.testing.assert_allclose(height, [[0.0, low], [low, 0.0]], rtol=1e-6)


def test_normals_are_red_east_green_north_blue_up(tmp_path, raster):
    normal = np.float32([[[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]])
    flat = np.zeros((1, 5), np.float32)
    colour = read(write_normal_png(tmp_path, Raster((1.0, 1.0), flat, normal, flat[..., None]))[0])
    assert colour.dtype == np.uint8
    expected = [[128, 128, 255], [255, 128, 128], [0, 128, 128], [128, 255, 128], [128, 0, 128]]
    assert colour[0].tolist() == expected

    colour = read(write_normal_png(tmp_path, raster)[0]).astype(np.float64)
    np.testing.assert_allclose(colour / 127.5 - 1, raster.normal, rtol=0, atol=0.5001 / 127.5)


def test_height_tif_is_bit_equal_with_vertices_at_their_positions(tmp_path, raster, terrain):
    (path,) = write_height_tif(tmp_path, raster)
    with rasterio.open(path, driver="GTiff") as file:
        assert (file.count, file.dtypes, file.units) == (1, ("float32",), ("m",))
        assert file.profile["compress"] == "deflate"
        assert file.tags()["AREA_OR_POINT"] == "Point"
        np.testing.assert_array_equal(file.read(1), raster.height)
        rows, columns = file.shape
        east, north = terrain.size
        assert file.xy(0, 0) == pytest.approx((0.0, north))  # the middle of a pixel is its vertex
        assert file.xy(rows - 1, columns - 1) == pytest.approx((east, 0.0))
        x, y = file.xy(20, 100)
        assert next(file.sample([(x, y)]))[0] == raster.height[20, 100]
    assert terrain.heights(x, y, cell_size=raster.spacing[0]) == raster.height[20, 100]

    (tmp_path / "b").mkdir()
    (second,) = write_height_tif(tmp_path / "b", raster)
    assert path.read_bytes() == second.read_bytes()


def test_material_files_hold_the_weights_padded_with_zeros(tmp_path, terrain, raster):
    *images, meaning = write_materials(tmp_path, raster, terrain.material_names)
    assert [path.name for path in images] == ["materials.png", "materials-2.png", "materials-3.png"]
    content = json.loads(meaning.read_text(encoding="utf-8"))["materials"]
    assert [entry["name"] for entry in content] == list(terrain.material_names)
    by_file = {path.name: np.asarray(Image.open(path)) for path in images}
    weights = np.stack([by_file[e["file"]][..., CHANNELS.index(e["channel"])] for e in content], axis=-1)
    assert weights.dtype == np.uint8
    assert (weights.sum(axis=-1, dtype=int) == 255).all()
    assert np.abs(weights - 255.0 * raster.materials).max() < 1.001

    weights = np.zeros((2, 3, 5), np.float32)
    weights[..., 4] = 1
    flat = np.zeros((2, 3), np.float32)
    *images, meaning = write_materials(tmp_path, Raster((1.0, 1.0), flat, flat, weights), list("abcde"))
    second = np.asarray(Image.open(images[1]))
    assert second.reshape(-1, 4).tolist() == [[255, 0, 0, 0]] * 6
    last = json.loads(meaning.read_text(encoding="utf-8"))["materials"][-1]
    assert last == {"name": "e", "index": 4, "file": "materials-2.png", "channel": "red"}


@given(some.lists(some.lists(some.floats(0, 1, width=32), min_size=8, max_size=8), min_size=1, max_size=9))
@settings(max_examples=80)
def test_quantised_weights_sum_to_255_with_errors_below_one(rows):
    weights = np.array([rows], np.float32)
    weights[weights.sum(axis=-1) == 0, 0] = 1
    result = quantise_weights(weights)
    exact = 255 * weights.astype(np.float64) / weights.sum(axis=-1, keepdims=True, dtype=np.float64)
    assert (result.sum(axis=-1, dtype=int) == 255).all()
    assert np.abs(result - exact).max() < 1 + 1e-6
    assert (result[weights == 0] == 0).all()


def test_largest_remainders_are_rounded_up():
    for weights, expected in [
        ([0, 1, 0], [0, 255, 0]),
        ([1, 1, 0], [128, 127, 0]),  # equal remainders: the first gets the step
        ([0.25, 0.5, 0.25], [64, 127, 64]),  # 63.75, 127.5, 63.75
        ([0.001, 0.001, 0.998], [0, 0, 255]),  # 0.255, 0.255, 254.49
    ]:
        assert quantise_weights(np.array([[weights]]))[0, 0].tolist() == expected, weights
    for invalid in [[0.0, 0.0], [-0.1, 1.1], [np.nan, 1.0], [np.inf, 0.0]]:
        refused("material weights", quantise_weights, np.array([[invalid]]))
    row = np.random.default_rng(1).random((1, 3, 8))
    assert (quantise_weights(np.broadcast_to(row, (600, 3, 8))) == quantise_weights(row)).all()


def test_splat_weights_include_the_edges_and_agree_between_tiles():
    ramp = np.arange(33)
    weights = np.zeros((33, 33, 3), np.uint8)
    weights[..., 0] = np.rint(ramp * 255 / 32)[None]
    weights[..., 1] = 255 - weights[..., 0]
    small = splat_weights(weights)
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
        west, east = (splat_weights(weights[:, left : left + 65]) for left in (0, 64))
        np.testing.assert_array_equal(west[:, -1], east[:, 0])


def test_control_map_values_are_finite_floats():
    weights = np.uint8([[[255, 0, 0], [0, 200, 55], [128, 127, 0], [85, 85, 85]]])
    bits = control_map(weights).view(np.uint32)[0].tolist()
    fields = [(b >> 27, b >> 22 & 0x1F, b >> 14 & 0xFF, b & 0x3FFF) for b in bits]
    assert fields == [(0, 0, 0, 0), (1, 2, 55, 0), (0, 1, 127, 0), (0, 1, 128, 0)]

    weights = np.zeros((1, 30 * 30, 30), np.uint8)
    pairs = [(a, b) for a in range(30) for b in range(30) if a != b]
    for i, (a, b) in enumerate(pairs):
        weights[0, i, a], weights[0, i, b] = 128, 127
    assert np.isfinite(control_map(weights[:, : len(pairs)])).all()
    refused("30 materials, got 31", control_map, np.zeros((1, 1, 31), np.uint8))


METRES = some.floats(-12_000.0, 12_000.0, width=32)


@given(some.lists(METRES, min_size=1, max_size=9))
def test_heights_round_trip_within_half_a_step(heights):
    height = np.array([heights], np.float32)
    steps = HeightQuantisation.from_heights(height)
    numbers = steps.encode(height)
    assert numbers.dtype == np.uint16
    assert all(float(f"{each:.3f}") == each for each in (steps.low, steps.range))  # whole millimetres
    off = np.abs(steps.low + numbers.astype(np.float64) * steps.range / 65536.0 - height)
    assert off.max() <= 0.5 * steps.step * (1.0 + 1e-9)
    assert steps.range <= max(1.0, float(np.ptp(height.astype(np.float64))) * 65536 / 65535 + 0.0025)


def test_quantisation_uses_the_full_range_and_refuses_heights_outside():
    height = np.float32([[0.0, 1000.0]])
    ((first, last),) = HeightQuantisation.from_heights(height).encode(height)
    assert first == 0 < 65534 <= last
    steps = HeightQuantisation.from_heights(np.full((3, 3), 812.5, np.float32))
    assert (steps.low, steps.range) == (812.5, 1.0)

    height = np.float32([[10.0, 1000.0]])
    steps = HeightQuantisation.from_heights(height, (-100.0, 1900.0))
    assert (steps.low, steps.range) == (-100.0, 2000.0)
    assert steps.highest == pytest.approx(1900.0 - 2000.0 / 65536.0)
    for requested in [(0.0, 500.0), (11.0, 1000.0), (10.0, 999.98)]:
        with pytest.raises(InputError, match=r"the terrain goes from 10\.00 to 1000\.00 m"):
            HeightQuantisation.from_heights(height, requested)
    for requested in [(5.0, 5.0), (5.0, 4.0), (float("nan"), 1.0), (0.0, float("inf"))]:
        refused("expected the lowest and the highest", HeightQuantisation.from_heights, height, requested)
    for outside in (-0.01, 100.0):
        refused("do not fit", HeightQuantisation(0.0, 100.0).encode, np.array([[outside]], np.float32))


def test_hillshade_of_planes_follows_lamberts_law():
    sketch = SimpleNamespace(pixel_size=4.0, width_px=6, height_px=5)
    sun = np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])
    for east, north in ((0.0, 0.0), (0.5, 0.0), (0.0, -0.75), (-1.5, 2.0), (3.0, -3.0)):
        terrain = SimpleNamespace(
            sketch=sketch, heights=lambda x, y, cell_size, e=east, n=north: e * x + n * y + 7.0
        )
        normal = np.array([-east, -north, 1.0]) / np.linalg.norm([east, north, 1.0])
        expected = 60.0 + 185.0 * max(normal @ sun, 0.0)
        np.testing.assert_allclose(_hillshade(terrain), np.full((5, 6), expected), rtol=1e-5)


SIZE = (64, 48)


def frames(count):
    """A bright bar that goes from left to right over a slope of colours."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    result = []
    for number in range(count):
        picture = np.stack([4 * x, 5 * y, np.full_like(x, 60)], axis=-1).astype(np.uint8)
        picture[:, 4 * number : 4 * number + 8] = (250, 240, 20)
        result.append(picture)
    return result


def write(path, count, *, fps=30, failure=None):
    with film(path, size=SIZE, fps=fps, frames=count) as add:
        for frame in frames(count):
            add(frame)
        if failure is not None:
            raise failure


def entries(folder):
    return sorted(each.name for each in folder.iterdir())


def test_frames_in_a_folder_are_numbered_and_exact(tmp_path):
    write(tmp_path / "new" / "frames", 12)
    assert entries(tmp_path / "new" / "frames") == [f"{number:04d}.png" for number in range(12)]
    for number, frame in enumerate(frames(12)):
        with Image.open(tmp_path / "new" / "frames" / f"{number:04d}.png") as image:
            np.testing.assert_array_equal(np.asarray(image), frame)

    from sketchterrain.export.film import _frame_name

    assert [_frame_name(number, 10_001) for number in (0, 10_000)] == ["00000.png", "10000.png"]
    assert _frame_name(9999, 10_000) == "9999.png"


def test_animated_images_have_all_frames_and_their_duration(tmp_path):
    for ending, near in [(".webp", 12), (".gif", 30)]:
        path = tmp_path / ending[1:] / f"a{ending}"
        write(path, 12, fps=30)
        assert entries(path.parent) == [path.name], ending
        length = 0
        with Image.open(path) as image:
            assert (image.size, image.n_frames) == (SIZE, 12), ending
            for decoded, frame in zip(ImageSequence.Iterator(image), frames(12), strict=True):
                difference = np.asarray(decoded.convert("RGB")).astype(int) - frame
                assert np.abs(difference).mean() < near, ending
                length += decoded.info["duration"]
        assert length == 400, ending

    for name in ("a.webp", "a.gif", "frames"):
        write(tmp_path / "one" / name, 1)
    assert entries(tmp_path / "one") == ["a.gif", "a.webp", "frames"]


def test_videos_have_all_frames_duration_and_colours(tmp_path):
    av = pytest.importorskip("av")
    path = tmp_path / "a.mp4"
    write(path, 12, fps=25)
    assert entries(tmp_path) == ["a.mp4"]
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height, stream.average_rate, stream.frames) == (*SIZE, 25, 12)
        for decoded, frame in zip(container.decode(stream), frames(12), strict=True):
            assert int(decoded.colorspace) == 1
            difference = decoded.to_ndarray(format="rgb24").astype(int) - frame
            assert np.abs(difference).mean() < 8
            assert np.abs(difference.mean(axis=(0, 1))).max() < 2  # no colour is off as a whole


def test_interrupted_films_leave_no_files(tmp_path):
    for name in ["frames", "a.webp", "a.gif", "a.mp4"]:
        for failure in [KeyboardInterrupt(), SketchterrainError("it broke")]:
            if name.endswith(VIDEO):
                pytest.importorskip("av")
            folder = tmp_path / f"{name}-{type(failure).__name__}"
            folder.mkdir()
            (folder / "a.webp").write_text("old")
            with pytest.raises(type(failure)):
                write(folder / name, 5, failure=failure)
            names = entries(folder)
            assert names == ["a.webp"] + ["frames"] * (name == "frames"), (name, failure)
            assert (folder / "a.webp").read_text() == "old", (name, failure)
            assert not list((folder / "frames").iterdir()) if name == "frames" else True, (name, failure)


def test_longer_films_odd_sides_missing_libraries_and_existing_files_are_refused(tmp_path, monkeypatch):
    write(tmp_path, 5)
    check_film(tmp_path, size=SIZE, frames=5)
    (tmp_path / "notes.png").write_text("mine")
    refused(r"frames of a longer film, 0003\.png to 0004\.png", check_film, tmp_path, size=SIZE, frames=3)
    refused(r"0000\.png to 0004\.png", check_film, tmp_path, size=SIZE, frames=20_000)

    pytest.importorskip("av")
    refused(r"even sides for an \.mp4, got 65×48", check_film, tmp_path / "a.mp4", size=(65, 48), frames=3)
    check_film(tmp_path / "a.webp", size=(65, 48), frames=3)
    (tmp_path / "file").write_text("mine")
    for path in (tmp_path / "file", tmp_path / "file" / "a.gif"):
        refused("expected a folder", check_film, path, size=SIZE, frames=3)

    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(SketchterrainError, match=r"pip install 'sketchterrain\[video\]'"):
        check_film(tmp_path / "a.mp4", size=SIZE, frames=3)
    assert set(ANIMATED) == {".webp", ".gif"}
