"""Lists of parts of draped features against distances and winding numbers."""

import re

import numpy as np
import shapely

from sketchterrain.benchmarks.host_painting import SAMPLES
from sketchterrain.features import items
from sketchterrain.host.library import SOURCES, host_function
from sketchterrain.io.resources import kernel_constants

SIDE, BLOCK, BLOCKS = 192, 8, 24
FAR = 0.75 + BLOCK * np.sqrt(0.5)


def listed(kind, lines, *, ends=3, reach=0.0, mitred=False, room=(4000, 40000)):
    """Return pieces, their items, (row from the south, column, item, piece), and the counts of all."""
    n, points = len(lines), np.concatenate([np.zeros((0, 2)), *lines])
    first = np.cumsum([0, *map(len, lines)])
    given = np.full(n, kind, np.int8), first, points, np.full(n, ends, np.uint8), np.full(n, float(reach))
    found = np.zeros((room[0], 8)), np.zeros(room[0], np.int32), np.zeros((room[1], 3), np.int32)
    count = np.zeros(2, np.int64)
    host_function("drape_pieces")(*given, np.full(n, mitred), *found, count, np.zeros_like(points))
    pieces, item, pairs = found[0][: count[0]], found[1][: count[0]], found[2][: count[1]]
    row, column = BLOCKS - 1 - pairs[:, 0] // BLOCKS, pairs[:, 0] % BLOCKS
    return pieces, item, np.column_stack([row, column, pairs[:, 1:]]), count


def distance(place, start, way):
    square = (way * way).sum()
    t = np.clip((place - start) @ way / square if square else np.zeros(len(place)), 0.0, 1.0)
    return np.hypot(*(place - start - t[:, None] * way).T)


def test_constants_are_those_of_the_kernels():
    text = (SOURCES / "painting.h").read_text(encoding="utf-8")
    own = {name: float(value) for name, value in re.findall(r"#define (\w+) ([\d.]+)", text)}
    for file, names in (("appearance.cl", "SIDE BLOCK"), ("drape.clh", "MITRE_LIMIT PIECE_JOINS")):
        assert kernel_constants(file, *names.split()) == tuple(own.pop(name) for name in names.split())
    (continues,) = kernel_constants("drape.clh", "PIECE_CONTINUES")
    assert own.pop("PIECE_CONTINUES") == continues
    assert own == {
        **{name: getattr(items, name) for name in ("STROKE", "FILL", "BEFORE", "AFTER")},
        "PIECE_STARTS": items.STARTS,
        "PIECE_ENDS": items.ENDS,
        "STEEPEST": 0.999,
    }


def test_texels_are_encoded_as_the_formulas_of_their_bytes_say():
    painted, moments, *found = arguments = SAMPLES["encode_texels"](40)
    host_function("encode_texels")(*arguments)
    east, north, square, alpha2, openness = moments.astype(np.float64).T
    steep = east**2 + north**2
    normal = -np.stack([east, north]) / np.sqrt(1.0 + steep)
    normal *= np.minimum(0.999 / np.maximum(np.hypot(*normal), 1e-9), 1.0)
    rough = np.clip(alpha2 + 2.0 * np.maximum(square - 0.5 * steep, 0.0), 0.0, 1.0) ** 0.25
    expected = (
        np.column_stack([np.sqrt(np.clip(painted[:, :3], 0.0, 1.0)), painted[:, 3]]),
        np.column_stack([*(0.5 + 0.5 * normal), rough, openness]),
    )
    for texels, values in zip(found, expected, strict=True):
        off = np.abs(texels - 255.0 * np.clip(values, 0.0, 1.0))
        assert off.max() < 0.501


def test_segments_and_points_are_in_all_blocks_that_they_may_cover():
    random = np.random.default_rng(1)
    middles = BLOCK * (np.indices((BLOCKS, BLOCKS))[::-1].reshape(2, -1).T + 0.5)
    for reach in (0.0, 1.5, 20.0):
        lines = [random.uniform(-60.0, SIDE + 60.0, (random.integers(1, 6), 2)) for _ in range(20)]
        points = [line[:1] for line in lines]
        for kind, shapes in ((items.STROKE, lines), (items.POINT, points)):
            pieces, item, pairs, _ = listed(kind, shapes, reach=reach)
            for number, (piece, owner) in enumerate(zip(pieces[2:], item[2:], strict=True), 2):
                own = pairs[pairs[:, 3] == number]
                assert (own[:, 2] == owner).all()
                away = distance(middles, piece[:2], piece[2:4]).reshape(BLOCKS, BLOCKS)
                listed_here = np.zeros((BLOCKS, BLOCKS), np.bool_)
                listed_here[own[:, 0], own[:, 1]] = True
                assert (away[listed_here] <= FAR + reach).all()
                assert listed_here[away < reach + BLOCK / 2].all()
        kept = {tuple(piece[:2]) for piece in listed(items.POINT, points, reach=reach)[0][2:]}
        inside = [p[0] for p in points if ((p[0] >= 0.0) & (p[0] <= SIDE)).all()]
        assert {tuple(p) for p in inside} <= kept


def test_strokes_know_their_ends_joins_and_places_along():
    line = np.array([[0.0, 5.0], [0.0, 5.0], [30.0, 5.0], [30.0, 45.0], [30.0, 45.0], [60.0, 85.0]])
    pieces, item, _, _ = listed(items.STROKE, [line[:0], line[:1], line], reach=1.0)
    assert item.tolist() == [0, 0, 2, 2, 2]
    assert pieces[2:, :4].tolist() == [[0, 5, 30, 0], [30, 5, 0, 40], [30, 45, 30, 40]]
    assert pieces[2:, 4].tolist() == [0, 30, 70]  # along
    assert pieces[2:, 5].tolist() == [1 | 8, 4 | 8, 2 | 4]
    assert pieces[2:, 6:].tolist() == [[0, 0], [1, 0], [0, 1]]
    for ends, expected in ((4, [[30, 5], [30, 45]]), (8, [[0, 5], [30, 5]]), (12, [[30, 5]])):
        runs = line[[0, 2, 3, 5]]
        assert listed(items.STROKE, [runs], ends=ends)[0][2:, :2].tolist() == expected
    # A mitre of a sharp corner reaches farther; long segments are cut near the square.
    corner = np.array([[100.0, -30.0], [100.0, -9.0], [112.0, -30.0]])
    assert [len(listed(items.STROKE, [corner], reach=4.0, mitred=m)[0]) for m in (False, True)] == [2, 3]
    piece = listed(items.STROKE, [np.array([[-(2.0**20), 10.0], [2.0**20, 10.0]])], reach=1.0)[0][2]
    assert piece[:4].tolist() == [-513.0, 10.0, 1218.0, 0.0]
    assert piece[4:6].tolist() == [2.0**20 - 513.0, 0.0]


def winding(edges, place):
    """Return the sum of crossings west of places: +1 of edges that run south."""
    (x, y), (east, north) = edges[:, :2].T, edges[:, 2:4].T
    low, high = np.minimum(y, y + north), np.maximum(y, y + north)
    crosses = (low <= place[1]) & (place[1] < high)
    at = x + east * (place[1] - y) / np.where(north == 0.0, 1.0, north)
    return int(-np.sign(north[crosses & (at < place[0])]).sum())


def test_blocks_have_the_winding_of_rings_everywhere():
    random = np.random.default_rng(2)
    for spread, step in ((30.0, 0.0), (150.0, 0.0), (90.0, 8.0), (5e5, 0.0)):
        for count in (1, 2, 3, 12):
            rings = [random.normal(SIDE / 2, spread, (count, 2)) for _ in range(2)]
            rings = [np.round(ring / step) * step if step else ring for ring in rings]
            rings = [np.concatenate([ring, ring[:1]]) for ring in rings]
            pieces, _, pairs, _ = listed(items.FILL, rings)
            for place in random.uniform(0.0, SIDE, (40, 2)):
                here = (pairs[:, :2] == (place[::-1] // BLOCK).astype(int)).all(axis=1)
                for number, ring in enumerate(rings):
                    edges = np.concatenate([ring[:-1], np.diff(ring, axis=0)], axis=1)
                    own = pieces[pairs[here & (pairs[:, 2] == number), 3]]
                    assert winding(own, place) == winding(edges, place), (spread, count)


def test_what_does_not_fit_is_counted():
    line = np.random.default_rng(3).uniform(0.0, SIDE, (30, 2))
    whole = listed(items.STROKE, [line], reach=2.0)
    for room in ((0, 0), (1, 7), tuple(whole[3])):
        part = listed(items.STROKE, [line], reach=2.0, room=room)
        assert part[3].tolist() == whole[3].tolist()
        for one, two, size in zip(part[:3], whole[:3], (room[0], room[0], room[1]), strict=True):
            assert np.array_equal(one, two[:size])
    assert listed(items.FILL, [])[3].tolist() == [2, 0]


def test_lines_are_as_far_as_shapely_says_and_run_around_what_is_inside():
    first, count, points, x, y, distances, turns = arguments = SAMPLES["lines_around"](300)
    host_function("lines_around")(*arguments)
    place = shapely.Point(x, y)
    for start, size, found, turned in zip(first, count, distances, turns, strict=True):
        own = points[start : start + size]
        line = shapely.LineString(own) if size > 1 else shapely.Point(own[0])
        assert np.isclose(found, line.distance(place), rtol=1e-9)
        if size > 3 and (own[0] == own[-1]).all() and shapely.is_valid(ring := shapely.Polygon(own)):
            assert (turned != 0) == ring.contains(place)
    assert (turns != 0).sum() > 5
