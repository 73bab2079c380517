"""Plain formats, read back by other libraries: heights, positions and orientation."""

import csv
import json

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scipy.spatial import cKDTree

SIDE = 65
FORMS = [("raw", "r16"), ("raw", "r16be"), ("raw", "r32"), ("png16", None), ("exr", None), ("npy", None)]


def read(path, tile):
    """Return a file's numbers."""
    if path.suffix == ".exr":
        return np.asarray(OpenEXR.File(str(path)).channels()["Y"].pixels)
    if path.suffix == ".npy":
        return np.asarray(np.load(path))
    if path.suffix == ".png":
        with Image.open(path) as image:
            return np.asarray(image)
    numbers = np.fromfile(path, {".r16": "<u2", ".r32": "<f4"}[path.suffix])
    return numbers.reshape(tile["rows"], tile["columns"])


def heights(done, tile=0):
    """Return a tile's heights in metres, decoded by the sidecar alone."""
    content = done.sidecar["heights"]
    endings = (".r16", ".r32", ".exr", "_height.npy", "_height.png")
    (path,) = (path for ending in endings for path in done.paths(ending)[tile : tile + 1])
    number = read(path, done.sidecar["tiles"][tile])
    if done.sidecar.get("byte_order") == "big-endian":
        number = number.byteswap()
    if content["numbers"] == "float32":
        return number.astype(np.float64)
    return content["low"] + number.astype(np.float64) * content["metres_per_step"]


@pytest.fixture(params=FORMS, ids=lambda form: form[1] or form[0])
def done(request, exported):
    target, form = request.param
    return exported(target, size=SIDE, **({"format": form} if form else {}))


def test_plain_exports_round_trip(done, terrain):
    content = done.sidecar["heights"]
    expected = terrain.heights(*done.places(), cell_size=done.sidecar["grid"]["spacing"]["x"])
    off = np.abs(heights(done) - expected)
    assert off.max() <= 0.5 * content.get("metres_per_step", 0.0) * (1 + 1e-9)
    assert (content["minimum"], content["maximum"]) == (expected.min(), expected.max())

    bed = weights(done)[..., 6]
    assert bed[:, : SIDE // 4].sum() > 0
    assert bed[:, SIDE // 2 :].sum() == 0

    assert (weights(done).sum(axis=-1, dtype=int) == 255).all()
    named = [each if isinstance(each, str) else each["name"] for each in done.sidecar["materials"]]
    assert named == list(terrain.material_names)

    path = (done.paths("_normal.npy") or done.paths("_normal.png"))[0]
    normal = read(path, done.sidecar["tiles"][0]).astype(np.float64) / 127.5 - 1.0
    dx, dy = (done.sidecar["grid"]["spacing"][axis] for axis in "xy")
    south, east = np.gradient(heights(done), dy, dx)
    slope = np.stack([-east, south, np.ones_like(east)], axis=-1)
    slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
    inner = (slice(1, -1), slice(1, -1))
    assert np.abs(normal - slope)[inner].max() < 0.02

    if done.sidecar["target"] == "npy":
        plants = np.load(done.paths("foliage.npy")[0])
        x, y, z = (plants[axis] for axis in "xyz")
        assert set(plants["species"]) <= set(range(len(done.sidecar["species"])))
    else:
        with done.paths("foliage.csv")[0].open(encoding="ascii") as stream:
            rows = list(csv.DictReader(stream))
        x, y, z = (np.array([float(row[axis]) for row in rows]) for axis in "xyz")
    assert len(x) > 100
    np.testing.assert_allclose(z, terrain.heights(x, y), atol=0.05)
    wood = (x > 34 * 16) & (x < 52 * 16) & (y > 8 * 16) & (y < 24 * 16)
    banks = [river.centreline[:, :2] for river in terrain.features.rivers]
    beside = cKDTree(np.concatenate(banks)).query(np.stack([x, y], axis=-1))[0] < 40.0
    beside |= (x > 1 * 16) & (x < 19 * 16) & (y > 3 * 16) & (y < 17 * 16)  # the lake
    assert (wood | beside).mean() > 0.8
    assert wood.mean() > 0.7

    content = json.loads(done.paths("features.json")[0].read_text(encoding="utf-8"))
    assert content["splines"][0]["id"] == terrain.features.rivers[0].id
    assert done.sidecar["grid"]["bounds"] == {"west": 0.0, "south": 0.0, "east": 1024.0, "north": 1024.0}


def weights(done):
    if done.sidecar["target"] == "npy":
        return np.asarray(np.load(done.paths("_materials.npy")[0]))
    images = [path for part in ("", "-2", "-3") for path in done.paths(f"_materials{part}.png")]
    return np.concatenate([np.asarray(Image.open(path)) for path in images], axis=-1)


def test_tiles_join_to_the_whole_at_the_positions_in_the_sidecar(exported, terrain):
    for overlap in [0, 1, 3]:
        side = 4 * 16 + overlap
        whole = exported("raw", size=side, format="r32", plants=False)
        cut = exported("raw", size=side, format="r32", plants=False, tiles=(4, 2), overlap=overlap)
        joined = np.full((side, side), np.nan)
        assert len(cut.sidecar["tiles"]) == 8, overlap
        assert not cut.paths("foliage.csv"), overlap
        for number, tile in enumerate(cut.sidecar["tiles"]):
            part = joined[tile["top"] :, tile["left"] :][: tile["rows"], : tile["columns"]]
            values = heights(cut, number)
            known = ~np.isnan(part)
            np.testing.assert_array_equal(part[known], values[known])
            part[:] = values
        np.testing.assert_array_equal(joined, heights(whole))

    done = exported("exr", size=SIDE, plants=False, tiles=(2, 2), tiles_from_south=True, tile_first=1)
    assert [(tile["x"], tile["y"]) for tile in done.sidecar["tiles"]] == [(1, 2), (2, 2), (1, 1), (2, 1)]
    for number, tile in enumerate(done.sidecar["tiles"]):
        path = done.paths(".exr")[number]
        assert path.name == f"high_corner_x{tile['x']}_y{tile['y']}_height.exr"
        expected = terrain.heights(*done.places(number), cell_size=16.0)
        np.testing.assert_array_equal(heights(done, number), expected)
