"""Packed vertices of tiles: their values, their parents', and the facts of each tile."""

from typing import Any

import numpy as np
import pytest

from sketchterrain.errors import DeviceFailedError, InputError
from sketchterrain.landforms.node_raster import node_level
from sketchterrain.terrain.surfaces import TILE_QUADS, vertex_dtype
from sketchterrain.terrain.vertex_writer import deviation_weights, sample_cell

from .conftest import half_sums, launches, tiers

# A parent, its four children and a grandchild; far and coarse tiles: each with its parent's index here.
FAMILY = [
    ((5, 15, 15), None),
    ((6, 30, 30), 0),
    ((6, 31, 30), 0),
    ((6, 30, 31), 0),
    ((6, 31, 31), 0),
    ((7, 61, 60), 1),
    ((5, -7, 900), None),
    ((-12, 0, -1), None),
    ((0, 0, 0), None),
    ((18, 1 << 17, 1 << 17), None),
]
KEYS = [key for key, _ in FAMILY]


def written_at(terrain, keys, parents=None, *, quads=64) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return the vertices and facts of tiles in consecutive slots."""
    store = terrain.vertex_store(len(keys), quads=quads)
    facts = terrain.write_tiles(keys, range(len(keys)), parents or [-1] * len(keys), store)
    return store.download(), facts


def written(terrain, order, *, quads=64) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return the family's vertices and facts in its order, written in any order."""
    store = terrain.vertex_store(len(FAMILY) + 2, quads=quads)
    slots = list(np.random.default_rng(4).permutation(len(FAMILY) + 2)[: len(FAMILY)])
    parents = [-1 if parent is None else slots[parent] for _, parent in FAMILY]
    facts = terrain.write_tiles(
        [KEYS[i] for i in order], [slots[i] for i in order], [parents[i] for i in order], store
    )
    return store.download()[slots], facts[np.argsort(order)]


def test_vertices_are_quantized_tiles(valley) -> None:
    """Heights are bit-equal, also the parents'; slopes and weights within half a step."""
    for materials, bytes_ in ((1, 24), (4, 24), (5, 32), (8, 32), (9, 40), (16, 48)):
        assert vertex_dtype(materials).itemsize == bytes_
    vertices, facts = written(valley, list(range(len(FAMILY))))
    for vertex, fact, tile, (_, parent) in zip(vertices, facts, valley.tiles(KEYS), FAMILY, strict=True):
        np.testing.assert_array_equal(vertex["height"], tile.height)
        np.testing.assert_allclose(vertex["slope"], tile.normal[..., :2] * 32767.0, rtol=0, atol=0.51)
        weights = vertex["weights"][..., : tile.materials.shape[-1]]
        np.testing.assert_allclose(weights, tile.materials * 255.0, rtol=0, atol=0.51)
        if parent is None:
            for name in ("height", "slope", "weights"):
                np.testing.assert_array_equal(vertex[f"parent_{name}"], vertex[name])
        else:
            np.testing.assert_array_equal(vertex["parent_height"], tile.parent_height)
        both = np.stack([vertex["height"], vertex["parent_height"]])
        assert (fact["low"], fact["high"]) == (both.min(), both.max())


def test_the_parents_part_equals_the_parents_vertices(valley) -> None:
    """Its values at its vertices, else half the sum along its edge or its north-west diagonal."""
    vertices, _ = written(valley, list(range(len(FAMILY))))
    for vertex, ((_, column, row), parent) in zip(vertices, FAMILY, strict=True):
        if parent is None:
            continue
        rows = slice(0, 33) if row % 2 else slice(32, None)
        columns = slice(32, None) if column % 2 else slice(0, 33)
        whole = vertices[parent][rows, columns]
        for name, half_step in (("height", 0.0), ("slope", 0.5), ("weights", 0.5)):
            own, of_parent = vertex[f"parent_{name}"].astype(float), whole[name].astype(float)
            np.testing.assert_array_equal(own[::2, ::2], of_parent)
            for (south, east), twice in half_sums(of_parent).items():
                middle = 0.5 * twice if half_step else np.float32(0.5) * twice.astype(np.float32)
                if half_step:
                    np.testing.assert_allclose(own[south::2, east::2], middle, rtol=0, atol=half_step)
                else:
                    np.testing.assert_allclose(own[south::2, east::2], middle, rtol=2e-7)


def test_any_order_gives_the_same_bytes(valley) -> None:
    """In one call, in any order, and with one call per tile."""
    straight, facts = written(valley, list(range(len(FAMILY))))
    for seed in range(3):
        order = list(np.random.default_rng(seed).permutation(len(FAMILY)))
        other, other_facts = written(valley, order)
        assert other.tobytes() == straight.tobytes()
        assert other_facts.tobytes() == facts.tobytes()
    store = valley.vertex_store(len(FAMILY))
    for slot, (key, parent) in enumerate(FAMILY):
        alone = valley.write_tiles([key], [slot], [-1 if parent is None else parent], store)
        assert alone.tobytes() == facts[slot : slot + 1].tobytes()
    assert store.download().tobytes() == straight.tobytes()


@pytest.mark.parametrize("quads", TILE_QUADS)
def test_tiles_of_any_size(valley, quads) -> None:
    """A level's tiles have the same width, and heights for their cell size."""
    level = 5
    width = valley.extent / 2**level
    store = valley.vertex_store(3, quads=quads)
    valley.write_tiles([(level, 14, 13), (level + 1, 29, 26)], [2, 0], [-1, 2], store)
    vertices = store.download()
    along = np.arange(quads + 1) / quads
    for slot, column, row, size in ((2, 14, 13, width), (0, 29, 26, width / 2)):
        x, y = np.meshgrid((column + along) * size, (row + 1 - along) * size)
        np.testing.assert_array_equal(vertices[slot]["height"], valley.heights(x, y, cell_size=size / quads))
    half = quads // 2
    np.testing.assert_array_equal(vertices[0]["parent_height"][::2, ::2], vertices[2]["height"][half:, half:])
    finest = {16: 20, 32: 19, 64: 18, 128: 17, 256: 16}[quads]
    valley.write_tiles([(finest, 5, 5)], [1], [-1], store)
    with pytest.raises(InputError, match=f"expected a tile level of -12 … {finest}, got {finest + 1}"):
        valley.write_tiles([(finest + 1, 5, 5)], [1], [-1], store)


def test_invalid_slots_parents_stores_and_non_finite_heights(valley) -> None:
    store = valley.vertex_store(4)
    for slots, parents in (
        *(([0], [-1]), ([1, 1], [-1, -1]), ([0, 4], [-1, -1])),
        *(([0, 1], [-2, -1]), ([0, 1], [4, -1]), ([0, 1], [-1])),
    ):
        with pytest.raises(InputError, match="slot"):
            valley.write_tiles([(3, 0, 0), (3, 1, 0)], slots, parents, store)
    with pytest.raises(InputError, match="expected quads of 16, 32, 64, 128, 256, got 48"):
        valley.vertex_store(4, quads=48)
    with pytest.raises(InputError, match="at least 1 slot"):
        valley.vertex_store(0)
    assert valley.write_tiles([], [], [], store).shape == (0,)

    valley.write_tiles([(4, 3, 3)], [0], [-1], store)
    valley.context.write(store.buffer, np.full(store.nbytes // 4, np.nan, np.float32)).wait()
    with pytest.raises(DeviceFailedError, match="produced non-finite heights"):
        valley.write_tiles([(5, 6, 6)], [1], [0], store)


def test_the_error_bounds_finer_detail(valley) -> None:
    """6,400 points per tile: 99 in 100 within δ, nine tiles in ten wholly within 4 δ.

    Features narrower than two quads can lie between samples: at banks a tile may differ more somewhere.
    Where tiles are judged by coarser nodes of the drained ground, finer ones deviate no more.
    """
    rng = np.random.default_rng(6)
    levels = [level for level in (1, 3, 4, 5, 6, 7) for _ in range(4)]
    keys = [(level, *(int(n) for n in rng.integers(0, 1 << level, 2))) for level in levels]
    keys += [(1, -7, 3), (0, 4, -2), (-1, 3, 3)]
    within, worst = [], []
    for (level, column, row), vertex, fact in zip(keys, *written_at(valley, keys), strict=True):
        u, v = rng.uniform(0, 64, (2, 6_400))
        i, j = u.astype(int), v.astype(int)
        u, v = u - i, v - j
        z = vertex["height"].astype(float)
        nw, ne, sw, se = z[j, i], z[j, i + 1], z[j + 1, i], z[j + 1, i + 1]
        flat = np.where(v > u, nw + v * (sw - nw) + u * (se - sw), nw + u * (ne - nw) + v * (se - ne))
        width = valley.extent / 2**level
        x, y = (column + (i + u) / 64) * width, (row + 1 - (j + v) / 64) * width
        cell = sample_cell(width / 64, valley.extent)
        (weight,) = np.minimum(deviation_weights(np.array([(level, column, row)]), valley.extent), 1.0)
        deviation = weight * np.abs(valley.heights(x, y, cell_size=cell) - flat)
        if node_level(width / 64, valley.extent):
            finer = np.abs(valley.heights(x, y, cell_size=width / 128) - flat)
            assert weight * np.quantile(finer, 0.99) < 1.1 * fact["error"]
        within.append(np.mean(deviation <= fact["error"]))
        worst.append(deviation.max() / fact["error"])
    assert np.mean(within) > 0.99
    assert min(within) > 0.98
    assert np.median(worst) < 2.0
    assert np.percentile(worst, 90) < 4.0


@tiers("quads", [64], TILE_QUADS)
def test_culling_by_squares_changes_no_bit(valley, quads, monkeypatch) -> None:
    keys = [(-2, 0, 0), (0, 0, 0), (1, 0, 1), (3, 3, 3), (3, 4, 5), (6, 31, 30)]
    found = []
    for least in (0.1, 200.0, np.inf):
        monkeypatch.setattr("sketchterrain.terrain.vertex_writer._MIN_SQUARE", least)
        found.append([part.tobytes() for part in written_at(valley, keys, quads=quads)])
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("quads", TILE_QUADS)
def test_the_error_is_sampled_at_every_second_quads_centre(valley, quads) -> None:
    """By single points of a finer cell size, which use other kernels."""
    keys = [(2, 1, 2), (6, 30, 31), (9, 250, 240)]
    for (level, column, row), vertex, fact in zip(keys, *written_at(valley, keys, quads=quads), strict=True):
        step = valley.extent / 2**level / quads
        stride = 1 if quads <= 32 else 2
        middle = 0.5 + np.arange(0, quads, stride)
        x, y = np.meshgrid((column * quads + middle) * step, ((row + 1) * quads - middle) * step)
        z = vertex["height"]
        flat = np.float32(0.5) * (z[:-1:stride, :-1:stride] + z[1::stride, 1::stride])
        cell = sample_cell(step, valley.extent)
        deviation = np.sort(np.abs(valley.heights(x, y, cell_size=cell) - flat).ravel())
        usual = deviation[int(np.ceil(0.99 * deviation.size)) - 1]
        (weight,) = deviation_weights(np.array([(level, column, row)]), valley.extent, quads)
        assert fact["error"] == weight * max(usual, deviation[-1] / np.float32(1.5))


def test_every_level_has_an_error(valley) -> None:
    """Wide tiles from one square in them; 0 at the finest level."""
    _, facts = written_at(valley, [(level, 0, 0) for level in range(-12, 19)], [-1, *range(30)])
    assert np.isfinite(facts["error"]).all()
    assert (facts["error"][:5] > 100).all()
    assert facts["error"][-1] == 0
    assert (facts["low"] <= facts["high"]).all()
    assert np.abs(facts["high"]).max() < 2000


def test_the_double_build_agrees(valley, double_context) -> None:
    """The same kernel in 64 bits: heights within a millimetre, the rest within a step."""
    double = type(valley)(valley.sketch, valley.recipe, double_context)
    keys, parents = [(5, 15, 15), (6, 31, 30)], [-1, 0]
    (single, facts), (exact, others) = (written_at(each, keys, parents) for each in (valley, double))
    for part in ("", "parent_"):
        np.testing.assert_allclose(single[f"{part}height"], exact[f"{part}height"], rtol=0, atol=2e-3)
        for name, most in (("slope", 40), ("weights", 6)):
            deviation = single[f"{part}{name}"].astype(int) - exact[f"{part}{name}"]
            assert np.abs(deviation).max() <= most
    np.testing.assert_allclose(facts["error"], others["error"], rtol=0, atol=4e-3)


def test_writing_allocates_and_launches_little(valley, calls) -> None:
    """Four launches per level, and one wait."""
    keys = [(6, c, r) for c in range(20, 28) for r in range(20, 28)] + [(5, 10, 10), (5, 11, 10)]
    store = valley.vertex_store(len(keys))
    parents = [-1] * len(keys)
    valley.write_tiles(keys, range(len(keys)), parents, store)
    calls.clear()
    valley.write_tiles(keys, range(len(keys)), parents, store)
    assert launches(calls) == ["patches", "vertices", "patches", "facts"] * 2
    assert calls.count("downloading") == 2
    assert "a buffer" not in calls
