from __future__ import annotations

import random
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.world.grid import CHUNK
from sketchterrain.world.zarr_layout import LAYERS
from sketchterrain.world.zarr_shards import INDEX_BYTES, Packing, chunk_place, pack_shard

HEIGHTS = LAYERS["height"].packing


def some(shape: tuple[int, ...], dtype: str, seed: int = 1) -> np.ndarray:
    """Values that are neither all alike nor all noise."""
    walk = np.random.default_rng(seed).normal(0, 1, shape).cumsum(-1)
    return walk.astype(dtype) if dtype == "float32" else (walk * 5).astype(np.int64).astype(dtype)


def unpack_all(content: bytes) -> None:
    for row in range(3):
        for column in range(2):
            HEIGHTS.unpack(found(content, row, column), (CHUNK, CHUNK))


def found(content: bytes, row: int, column: int) -> bytes:
    offset, size = chunk_place(content[-INDEX_BYTES:], row, column, length=len(content))
    return content[offset : offset + size]


@pytest.mark.parametrize("name", LAYERS)
def test_chunks_of_every_layer_come_back(name: str) -> None:
    layer = LAYERS[name]
    values = some(layer.shape(300, 700), layer.packing.dtype)
    content = b"".join(pack_shard(values, layer.packing, layer.fill))
    for row in range(2):
        for column in range(3):
            chunk = layer.packing.unpack(found(content, row, column), layer.shape(CHUNK, CHUNK))
            part = values[..., row * CHUNK : (row + 1) * CHUNK, column * CHUNK : (column + 1) * CHUNK]
            assert chunk.dtype == values.dtype
            np.testing.assert_array_equal(chunk[..., : part.shape[-2], : part.shape[-1]], part)
    corner = layer.packing.unpack(found(content, 1, 2), layer.shape(CHUNK, CHUNK))
    np.testing.assert_array_equal(corner[..., -1, -1], layer.fill)  # beyond the values


def test_chunks_beyond_the_values_are_not_there() -> None:
    content = b"".join(pack_shard(some((CHUNK, CHUNK), "float32"), HEIGHTS, np.nan))
    with pytest.raises(InputError, match=r"row 0, column 1 is not in it"):
        chunk_place(content[-INDEX_BYTES:], 0, 1, length=len(content))


def test_the_same_values_are_the_same_bytes_in_any_thread() -> None:
    values = some((8, 520, 520), "uint8")
    packing = LAYERS["materials"].packing
    here = pack_shard(values, packing, 0)
    with ThreadPoolExecutor(4) as pool:
        for there in pool.map(lambda _: pack_shard(values, packing, 0), range(8)):
            assert there == here


def test_views_are_packed_as_what_they_show() -> None:
    values = some((512, 512), "float32")
    assert pack_shard(values[::2, ::2], HEIGHTS, 0) == pack_shard(values[::2, ::2].copy(), HEIGHTS, 0)


def test_any_broken_byte_is_found() -> None:
    content = b"".join(pack_shard(some((600, 300), "float32"), HEIGHTS, np.nan))
    rng = random.Random(5)
    index = range(len(content) - INDEX_BYTES, len(content))
    for place in [0, *rng.sample(range(len(content)), 60), *rng.sample(index, 20), len(content) - 1]:
        broken = bytearray(content)
        broken[place] ^= 1 << rng.randrange(8)
        with pytest.raises(InputError, match="its checksum is wrong"):
            unpack_all(bytes(broken))


@pytest.mark.parametrize("left", [0, 1, 100, INDEX_BYTES - 1, INDEX_BYTES, 5000])
def test_a_shard_that_is_cut_off_is_found(left: int) -> None:
    content = b"".join(pack_shard(some((CHUNK, CHUNK), "float32"), HEIGHTS, np.nan))[:left]
    with pytest.raises(InputError, match=r"cut off after \d+ bytes|checksum"):
        found(content, 0, 0)


def test_a_whole_chunk_of_another_shape_is_refused() -> None:
    packed = HEIGHTS.pack(some((4, 4), "float32"))
    with pytest.raises(InputError, match="a chunk holds 16 values, expected 65536"):
        HEIGHTS.unpack(packed, (CHUNK, CHUNK))


def test_what_is_no_chunk_of_blosc_is_refused() -> None:
    from sketchterrain.world.zarr_shards import with_checksum

    with pytest.raises(InputError, match="a chunk cannot be unpacked"):
        HEIGHTS.unpack(with_checksum(b"no chunk"), (CHUNK, CHUNK))


def test_codecs_are_those_of_the_specification() -> None:
    names = [codec["name"] for codec in Packing("uint8", "bitshuffle", 1).codecs]
    assert names == ["bytes", "blosc", "crc32c"]
    assert Packing("uint8", "bitshuffle", 1).codecs[0] == {"name": "bytes"}  # single bytes have no order
    assert HEIGHTS.codecs[1]["configuration"]["typesize"] == 4
