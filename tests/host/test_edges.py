"""Sums of areas over texels against polygons, edges near blocks against fractions."""

from fractions import Fraction
from math import ceil

import numpy as np
import shapely

from sketchterrain.host.library import host_function

NEVER = np.iinfo(np.int32).max


def test_sums_are_the_areas_of_polygons_in_texels():
    random = np.random.default_rng(1)
    for rows, columns in ((0, 3), (3, 0), (1, 1), (2, 5), (6, 4)):
        total, expected = np.full((rows, columns, 4), 7), np.full((rows, columns, 4), 7.0)
        edges, values = [np.zeros((0, 4))], [np.zeros((0, 4))]
        for step in (0.0, 1.0, 0.0):  # also along borders of texels
            ring = shapely.MultiPoint(random.uniform(-2.0, 8.0, (9, 2))).convex_hull.exterior.coords
            ring = np.array(ring)[::-1]
            ring = np.round(ring) if step else ring
            own = random.uniform(0.0, 2.0**20, 4)
            edges.append(np.concatenate([ring[:-1], np.diff(ring, axis=0)], axis=1))
            values.append(np.broadcast_to(own, (len(ring) - 1, 4)))
            area = shapely.Polygon(ring)
            for row, column in np.ndindex(rows, columns):
                inside = area.intersection(shapely.box(column, row, column + 1, row + 1)).area
                expected[row, column] += own * (inside if area.exterior.is_ccw else -inside)
        given = np.concatenate(edges), np.concatenate(values)
        host_function("sum_edges")(*given, total, np.full((rows, columns + 1, 4), 9))
        assert np.abs(total - expected).max(initial=0.0) < 32.0  # roundings of an edge in a texel


def near_plainly(edges, block, reach):
    """Return whether a block's south-east corner is inside of edges in whole units, ends and rows nearby."""
    inside, ends, rows = False, [], []
    side, top = block[2] - block[0], block[3] - block[1]
    for edge in edges:
        (y, x), (to_y, to_x) = sorted(((edge[1], edge[0]), (edge[3], edge[2])))
        x, to_x, y, to_y = x - block[0], to_x - block[0], y - block[1], to_y - block[1]
        if y <= 0 < to_y:
            at = x + Fraction(-y * (to_x - x), to_y - y)
            inside ^= at > side or (at == side and to_x > x)
        if max(x, to_x) < -reach or min(x, to_x) > side + reach or to_y < -reach or y > top + reach:
            continue
        ends.append([x, y, to_x, to_y])
        low, high, cut = y, to_y, NEVER
        if (x > side) != (to_x > side):
            row = ceil(y + Fraction((to_y - y) * (side - x), to_x - x))
            low, high = (max(low, row), high) if x > side else (low, min(high, row))
            cut = row if row > 0 else NEVER
        elif x > side:
            high = low
        rows.append([low, high, cut, 0])
    return inside, ends, rows


def test_edges_near_blocks_are_those_of_exact_arithmetic():
    random = np.random.default_rng(2)
    for spread in (3, 40, 10**7):
        counts = random.integers(0, 7, 60)
        first = np.append(0, np.cumsum(counts))
        edges = random.integers(-spread, spread + 1, (first[-1], 4))
        low = random.integers(-20, 20, (60, 2))
        blocks = np.concatenate([low, low + random.integers(0, 30, (60, 2))], axis=1)
        inside, count = np.zeros(60, np.bool_), np.zeros(60, np.int64)
        ends, rows = np.zeros((2, len(edges), 4), np.int32)
        unit = 0.25
        given = first, edges * unit + 0.1, blocks, 5, unit, 1 << 30
        total = host_function("edges_near")(*given, inside, count, ends, rows)
        found = [
            near_plainly(edges[a:b].tolist(), block.tolist(), 5)
            for a, b, block in zip(first[:-1], first[1:], blocks, strict=True)
        ]
        assert inside.tolist() == [each[0] for each in found]
        assert count.tolist() == [len(each[1]) for each in found]
        for array, column in ((ends, 1), (rows, 2)):
            assert array[:total].tolist() == [row for each in found for row in each[column]]
    none = np.zeros((0, 4))
    lists = np.zeros(0, np.bool_), np.zeros(0, np.int64), *np.zeros((2, 0, 4), np.int32)
    given = np.zeros(1, np.int64), none, none.astype(np.int64)
    assert host_function("edges_near")(*given, 5, 1.0, 9, *lists) == 0


def test_far_ends_are_cut():
    ends, rows = np.zeros((2, 1, 4), np.int32)
    given = np.array([0, 1]), np.array([[-9.0, -50.0, 4.0, 70.0]]), np.array([[0, 0, 8, 8]]), 1, 1.0, 20
    counted = np.zeros(1, np.bool_), np.zeros(1, np.int64)
    assert host_function("edges_near")(*given, *counted, ends, rows) == 1
    assert ends.tolist() == [[-9, -20, 4, 20]]
    assert rows.tolist() == [[-20, 20, NEVER, 0]]
