"""Cloud-Optimised GeoTIFFs from packed blocks: read by GDAL, and byte by byte without it."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import rasterio
from rasterio.io import MemoryFile

from sketchterrain.world import cloud_layout
from sketchterrain.world.cloud_layout import cloud_optimised
from sketchterrain.world.grid import World
from sketchterrain.world.tiff_blocks import means, packed
from sketchterrain.world.tiff_directory import read_directories
from sketchterrain.world.tiff_layers import DOMAIN, TIFF_LAYERS, Georeference

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from sketchterrain.world.job import Job

SIZE = (517, 300)  # rows and columns: blocks at two edges hold less


@pytest.fixture(scope="module")
def place(small_job: Job) -> Georeference:
    world = World(100.0, 200.0, 399.0, 716.0, 1.0)
    return Georeference(replace(small_job, world=world, crs="EPSG:25832", origin=(5e5, 5.4e6)))


def values_of(layer: str, size: tuple[int, int] = SIZE) -> NDArray:
    form = TIFF_LAYERS[layer]
    row, column = np.indices(size)
    wave = 50.0 * np.sin(column / 31.0) + 0.1 * row
    bands = np.stack([wave + index for index in range(len(form.bands))])
    return (bands if form.dtype == "float32" else np.abs(bands)).astype(form.dtype)


def file_of(place: Georeference, layer: str, values: NDArray, factors: tuple[int, ...] = (4, 8)) -> bytes:
    form = TIFF_LAYERS[layer]
    sheets = [packed(form, values), *(packed(form, means(form, values, factor)) for factor in factors)]
    tags = place.tags(form, place.transform(place.job.world.levels[0]), {"west": "100.0"})
    return b"".join(cloud_optimised(sheets, tags))


def directories(content: bytes) -> Iterator[tuple[int, dict[int, tuple[int, ...]]]]:
    """Read where each image file directory stands and its whole numbers; classic or big."""
    big = content[:4] == b"II+\0"
    assert big or content[:4] == b"II*\0"
    word, count_form, entry_form, step = ("<Q", "<Q", "<HHQ", 20) if big else ("<I", "<H", "<HHI", 12)
    inline = struct.calcsize(word)
    (at,) = struct.unpack_from(word, content, 8 if big else 4)
    while at:
        (count,) = struct.unpack_from(count_form, content, at)
        first = at + struct.calcsize(count_form)
        tags = {}
        for entry in range(first, first + step * count, step):
            tag, kind, length = struct.unpack_from(entry_form, content, entry)
            if kind in (3, 4, 16):
                form = f"<{length}{ {3: 'H', 4: 'I', 16: 'Q'}[kind] }"
                where = entry + step - inline
                if struct.calcsize(form) > inline:
                    (where,) = struct.unpack_from(word, content, where)
                    assert where % 2 == 0
                tags[tag] = struct.unpack_from(form, content, where)
        yield at, tags
        (at,) = struct.unpack_from(word, content, first + step * count)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("layer", ["height", "normal", "materials"])
def test_gdal_reads_the_values_their_names_and_the_place(place, layer: str, big: bool, monkeypatch) -> None:
    if big:
        monkeypatch.setattr(cloud_layout, "_CLASSIC", 0)
    values = values_of(layer)
    content = file_of(place, layer, values)
    assert content[:4] == (b"II+\0" if big else b"II*\0")
    with MemoryFile(content) as memory:
        with memory.open() as file:
            np.testing.assert_array_equal(file.read(), values)
            assert file.descriptions == TIFF_LAYERS[layer].bands
            assert file.crs.to_epsg() == 25832
            assert file.xy(0, 0) == (500_100.0, 5_400_716.0)  # pixels are vertices
            assert file.tags()["AREA_OR_POINT"] == "Point"
            assert file.tags(ns=DOMAIN) == {"west": "100.0"}
            assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
            assert file.block_shapes == [(256, 256)] * len(values)
            assert file.overviews(1) == [4, 8]
            if layer == "height":
                assert file.units == ("m",)
        for index, factor in enumerate((4, 8)):
            with memory.open(overview_level=index) as file:
                np.testing.assert_array_equal(file.read(), means(TIFF_LAYERS[layer], values, factor))


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("layer", ["height", "materials"])
def test_blocks_lie_as_the_file_says_that_they_do(place, layer: str, big: bool, monkeypatch) -> None:
    """As GDAL's validate_cloud_optimized_geotiff.py wants it, but read without GDAL."""
    if big:
        monkeypatch.setattr(cloud_layout, "_CLASSIC", 0)
    content = file_of(place, layer, values_of(layer))
    found = list(directories(content))
    starts = [at for at, _ in found]
    assert starts == sorted(starts)
    told = content[16 if big else 8 :]
    assert told.startswith(b"GDAL_STRUCTURAL_METADATA_SIZE=")
    size = int(told[30:36])
    assert told[37:43] == b"bytes\n"
    assert starts[0] - (16 if big else 8) - 43 - size in (0, 1)
    at = 0
    for _, tags in reversed(found):  # the coarsest image's blocks come first
        assert tags[322] == tags[323] == (256,)
        assert len(tags[324]) == -(-tags[256][0] // 256) * -(-tags[257][0] // 256)
        for offset, length in zip(tags[324], tags[325], strict=True):
            assert offset > max(at, starts[-1])
            assert at in (0, offset - 4)
            assert int.from_bytes(content[offset - 4 : offset], "little") == length
            at = offset + length + 4
            assert content[at - 8 : at - 4] == content[at - 4 : at]
    assert at == len(content)
    assert [tags[254] for _, tags in found] == [(0,), (1,), (1,)]
    assert [(tags[257][0], tags[256][0]) for _, tags in found] == [SIZE, (130, 75), (65, 38)]


def test_what_is_told_of_the_layout_is_what_gdal_tells_of_its_own(place) -> None:
    values = values_of("height")
    ours = file_of(place, "height", values)
    with MemoryFile() as memory:
        with memory.open(
            driver="COG",
            width=SIZE[1],
            height=SIZE[0],
            count=1,
            dtype="float32",
            crs=place.crs,
            transform=place.transform(place.job.world.levels[0]),
            blocksize=256,
            compress="deflate",
        ) as file:
            file.write(values)
        theirs = bytes(memory.getbuffer())
    end = 8 + 43 + int(theirs[38:44])
    assert ours[8:end] == theirs[8:end]


def test_the_same_values_give_the_same_bytes(place) -> None:
    values = values_of("normal")
    assert file_of(place, "normal", values) == file_of(place, "normal", values.copy())


def test_a_grid_of_one_vertex_or_one_column_is_a_file_too(place) -> None:
    for size in ((1, 1), (300, 1), (1, 257)):
        values = values_of("materials", size)
        with MemoryFile(file_of(place, "materials", values, ())) as memory, memory.open() as file:
            np.testing.assert_array_equal(file.read(), values)


def test_a_mean_is_that_of_the_vertices_that_are_there() -> None:
    values = np.arange(35, dtype=np.float32).reshape(1, 5, 7)
    mean = means(TIFF_LAYERS["height"], values, 4)
    assert mean.shape == (1, 2, 2)
    assert mean.dtype == np.float32
    np.testing.assert_allclose(mean[0], [[12.0, 15.5], [29.5, 33.0]])
    high = np.full((2, 9, 9), 255, np.uint8)
    np.testing.assert_array_equal(means(TIFF_LAYERS["normal"], high, 8), np.full((2, 2, 2), 255, np.uint8))


def test_means_of_weights_are_weights() -> None:
    noise = np.random.default_rng(3).random((8, 50, 70)) ** 8
    noise[5] = 0.0
    edges = np.rint(255.0 * np.cumsum(noise, axis=0) / noise.sum(axis=0))
    weights = np.diff(edges, axis=0, prepend=0.0).astype(np.uint8)
    mean = means(TIFF_LAYERS["materials"], weights, 4)
    assert mean.shape == (8, 13, 18)
    assert np.all(mean.sum(axis=0, dtype=int) == 255)
    assert np.all(mean[5] == 0)
    exact = weights[:, :48, :68].reshape(8, 12, 4, 17, 4).mean(axis=(2, 4))
    assert np.abs(mean[:, :12, :17] - exact).max() <= 1.0


@pytest.mark.parametrize(
    "content", [b"", b"MM\0*\0\0\0\x08", b"II*\0\xff\0\0\0", b"II*\0\x08\0\0\0\x01\0\xff\xff\xff\xff"]
)
def test_what_is_no_tiff_is_refused(content: bytes) -> None:
    with pytest.raises(ValueError, match="TIFF"):
        read_directories(content)


def test_no_crs_is_metres_from_the_sketchs_corner(small_job, tmp_path) -> None:
    place = Georeference(replace(small_job, crs=None))
    path = tmp_path / "local.tif"
    path.write_bytes(file_of(place, "height", values_of("height"), ()))
    with rasterio.open(path) as file:
        assert file.crs.to_epsg() is None
        assert 'UNIT["metre",1' in file.crs.to_wkt()
        assert file.xy(0, 0) == (small_job.world.west, small_job.world.north)
