"""The loops of elevation, mesh errors, horizon culling and draped cutting, against plain formulations."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.interpolate import BSpline
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from sketchterrain.benchmarks.host_elevation import SAMPLES
from sketchterrain.host.library import host_function

GRID = 1e-9  # of overlays, which are then robust without exceptions that sanitizers stop at


def called(name: str, size: int) -> tuple[Any, ...]:
    arguments = SAMPLES[name](size)
    host_function(name)(*arguments)
    return arguments


def basis(t: np.ndarray, count: int) -> np.ndarray:
    """Return the weights (n, count) of a cubic B-spline's coefficients at steps from the second one."""
    element = BSpline.basis_element(np.arange(-2.0, 3.0), extrapolate=False)
    return np.nan_to_num(element(np.asarray(t)[:, None] + 1.0 - np.arange(count)))


def smooth(t: np.ndarray) -> np.ndarray:
    t = np.clip(t, 0.0, 1.0)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t * t)


@pytest.mark.parametrize("size", [5, 70])
def test_a_surface_is_the_weighted_mean_of_its_patches(size: int) -> None:
    x, y, centre, to_steps, density, base, grid, coefficients, mask_of, masks, rims, *rest = called(
        "evaluate_surface", size
    )
    values, height, _, _, data, count, means = rest[4:11]
    total, mean, missing, number = np.zeros(x.size), np.zeros((3, x.size)), np.ones(x.size), np.zeros(x.size)
    for p in range(len(centre)):
        dx, dy = x - centre[p, 0], y - centre[p, 1]
        terms = np.stack([np.ones_like(dx), dx, dy, dx * dx, dx * dy, dy * dy])
        u, v = np.nan_to_num(to_steps[p] @ terms, nan=99.0)
        inside = (np.abs(u) < 16.0) & (np.abs(v) < 16.0)
        weight = smooth((16.0 - np.abs(u)) / 4.0) * smooth((16.0 - np.abs(v)) / 4.0)
        known, across, down = 1.0, basis(u + 16.0, 35), basis(v + 16.0, 35)
        if mask_of[p] >= 0:
            west, east, north, south, scale = rims[mask_of[p]]
            distance = np.minimum(u - west, east - u), np.minimum(v - north, south - v)
            rim = smooth(1.5 + scale * distance[0]) * smooth(1.5 + scale * distance[1])
            part = np.einsum("ni,ij,nj->n", down, masks[mask_of[p]] / 225.0, across)
            known, weight = rim * smooth(8100.0 * part), weight * part * rim
        weight = np.where(inside, weight * density[p], 0.0)
        missing *= 1.0 - np.where(
            weight > 0.0, known * smooth(16.0 - np.abs(u)) * smooth(16.0 - np.abs(v)), 0.0
        )
        number += weight > 0.0
        total += weight
        mean[0] += weight * (base[p] + np.einsum("ni,ij,nj->n", down, coefficients[p], across))
        mean[1:] += weight * values[grid[p]][:, None]
    np.testing.assert_array_equal(count, number)
    clear = total > 1e-6 * total.max()
    np.testing.assert_allclose(height[clear], (mean[0] / np.where(clear, total, 1.0))[clear], atol=1e-8)
    np.testing.assert_allclose(means[:, clear], (mean[1:] / np.where(clear, total, 1.0))[:, clear], atol=1e-8)
    np.testing.assert_allclose(data, np.where(total > 0.0, 1.0 - missing, 0.0), atol=1e-9)
    assert np.isnan(height[total == 0.0]).all()
    assert not means[:, total == 0.0].any()
    assert np.isnan(height[0])


def test_slopes_of_a_surface_are_derivatives_of_its_height() -> None:
    evaluate, step = host_function("evaluate_surface"), 1e-5
    arguments = [*called("evaluate_surface", 60)]
    height, east, north, data = arguments[16:20]
    found = []
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        moved = [*arguments[:16], *np.zeros((5, height.size)), *arguments[21:]]
        moved[axis] = moved[axis] + sign * step
        evaluate(*moved)
        found.append(moved[16])
    solid = data > 0.5
    for slope, more, less in ((east, *found[:2]), (north, *found[2:])):
        off = np.abs((more - less) / (2.0 * step) - slope)[solid & np.isfinite(more + less)]
        assert np.quantile(off, 0.999) < 1e-3


def test_the_error_of_a_patch_is_its_largest_distance_from_samples() -> None:
    for size in (5, 130):
        spline, _, samples, _, base, *_, error = called("measure_patches", size)
        row, column = np.arange(size) / 4.0, np.arange(size) / 4.0
        surface = basis(row + 2.0, len(spline)) @ spline @ basis(column + 2.0, len(spline)).T
        off = np.abs(surface + base - samples)
        for a in range(len(error)):
            for b in range(len(error)):
                mine = [(at >= 28 * k - 2) & (at < 28 * k + 30) for k, at in ((a, row), (b, column))]
                assert error[a, b] == pytest.approx(np.nanmax(off[np.ix_(*mine)]), abs=1e-9)
    # In strips the same.
    arguments = [*SAMPLES["measure_patches"](130)]
    for start in range(0, 130, 50):
        arguments[2:4] = samples[start : start + 50], start
        host_function("measure_patches")(*arguments)
    np.testing.assert_array_equal(arguments[-1], error)


def grown(boxes: np.ndarray, growth: np.ndarray, first: np.ndarray, corners: np.ndarray) -> list[Any]:
    """Return the kernels, and the same grown by so many metres."""
    wide = np.repeat(growth, np.diff(first))
    parts = shapely.polygons(corners), shapely.buffer(shapely.polygons(corners), wide, join_style="mitre")
    return [np.array([shapely.union_all(each[a:b]) for a, b in pairwise(first)]) for each in parts]


def test_tops_are_the_errors_at_which_greater_patches_cover_a_kernel() -> None:
    for size in (1, 2, 40):
        which, rank, error, finest, grid, *kernels = called("compute_tops", size)[:9]
        top, is_best = called("compute_tops", size)[15:17]
        own, more = grown(*kernels)
        for p in which:
            key = [(-rank[q], error[q], q) for q in which]
            greater = sorted((q for q in which if key[q] < key[p]), key=lambda q: (error[q], q))
            better = [
                q
                for q in which
                if finest[q] and grid[q] != grid[p] and (error[q], -rank[q], q) < (error[p], -rank[p], p)
            ]
            left, expected = own[p], np.inf
            for q in greater:
                left = shapely.difference(left, more[q], grid_size=GRID)
                if left.area < 1e-6:
                    expected = error[q]
                    break
            assert top[p] == expected, p
            rest = shapely.difference(own[p], shapely.union_all(more[better]), grid_size=GRID)
            assert is_best[p] == (finest[p] and rest.area >= 1e-6), p


def test_a_kernel_in_too_many_pieces_counts_as_not_covered() -> None:
    west = np.append(
        np.linspace(1.0, 999.0, 600) - 0.2, [-1.0, 0.0]
    )  # small ones, one around all, and the kernel
    size = np.append(np.full(600, 0.4), [1002.0, 1000.0])
    boxes = np.column_stack([west, np.full(602, -0.2), west + size, np.full(602, 0.2)])
    boxes[600:, 1:4:2] = [[-3.0, 3.0], [-2.0, 2.0]]
    corners = boxes[:, [[0, 1], [2, 1], [2, 3], [0, 3]]].copy()
    index = np.array([[-1.0, -4.0, 1024.0]]), np.array([[1, 1, 0]]), np.array([0, 602]), np.arange(602)
    for around, expected in ((0.5, 0.5), (9.0, np.inf)):
        error, rank = np.append(np.ones(600), [around, 0.0]), np.append(np.ones(601, np.int64), 0)
        order = np.array([601]), rank, error, np.zeros(602, bool), np.zeros(602, np.int32)
        kernels = boxes, np.full(602, 1e-3), np.arange(603), corners
        top, is_best = np.zeros(1), np.zeros(1, bool)
        scratch = *np.zeros((2, 602), np.int64), *np.zeros((2, 1204)), *called("compute_tops", 2)[-2:]
        host_function("compute_tops")(*order, *kernels, *index, 0, 1, top, is_best, *scratch)
        assert top[0] == expected


def test_nodes_within_grown_kernels_are_marked() -> None:
    for size in (2, 5, 41):
        boxes, grow, first, corners, west, south, spacing, inside = called("mark_kernels", size)
        x, y = west + spacing * np.arange(size), south + spacing * np.arange(size)
        covered = shapely.union_all(grown(boxes, grow, first, corners)[1])
        np.testing.assert_array_equal(inside, shapely.contains_xy(covered, *np.meshgrid(x, y)))


def test_a_void_is_filled_by_the_membrane_of_its_border() -> None:
    samples, labels, *_ = SAMPLES["fill_voids"](40)
    filled, _, _, chosen, *_ = called("fill_voids", 40)
    void = np.isin(labels, chosen + 1)
    np.testing.assert_array_equal(filled[~void], samples[~void])
    row, column = np.nonzero(void)
    number = np.full(void.shape, -1)
    number[void] = np.arange(len(row))
    pairs, known = [(np.arange(len(row)), np.arange(len(row)), np.full(len(row), 4.0))], np.zeros(len(row))
    for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        at = number[row + down, column + right]
        pairs.append((np.arange(len(row))[at >= 0], at[at >= 0], np.full(np.count_nonzero(at >= 0), -1.0)))
        known += np.where(at < 0, samples[row + down, column + right], 0.0)
    i, j, value = (np.concatenate(each) for each in zip(*pairs, strict=True))
    np.testing.assert_allclose(filled[void], spsolve(coo_array((value, (i, j))).tocsr(), known), atol=2e-3)
    # Only those that are asked for.
    arguments = [*SAMPLES["fill_voids"](40)]
    arguments[3:5] = chosen[:1], arguments[4][:1]
    host_function("fill_voids")(*arguments)
    np.testing.assert_array_equal(np.isnan(arguments[0]), np.isnan(samples) & (labels != chosen[0] + 1))


def test_the_distance_of_a_mesh_is_measured_at_all_vertices_in_its_triangles() -> None:
    for size in (2, 3, 13):
        triangles, column, row, corner, height, _ = SAMPLES["largest_distance"](size)
        expected, missed = 0.0, np.ones((size, size), bool)
        for a, b, c in triangles.astype(int):
            area = np.linalg.det([[1, column[k], row[k]] for k in (a, b, c)]).round()
            for i, j in np.ndindex(size, size):
                parts = []
                for one, other in ((b, c), (c, a), (a, b)):
                    part = (column[one] - j) * (row[other] - i) - (column[other] - j) * (row[one] - i)
                    parts.append(part * np.sign(area))
                if area and min(parts) >= 0:
                    missed[i, j] = False
                    off = abs(np.dot(parts, corner[[a, b, c]]) / abs(area) - height[i, j])
                    expected = max(expected, off)  # NaN is not more
        arguments = SAMPLES["largest_distance"](size)
        assert host_function("largest_distance")(*arguments) == pytest.approx(expected, rel=1e-12)
        np.testing.assert_array_equal(arguments[-1], missed)


def test_boxes_below_the_horizon_of_nearer_ground_are_hidden() -> None:
    for size in (1, 2, 60):
        arguments = called("test_against_horizon", size)
        tested, limit, first, last, most, raising, far, ground_first, ground_last, bottom, hidden, _ = (
            arguments
        )
        expected = np.zeros(size, bool)
        for box in tested:
            horizon = np.full(2048, -np.inf)
            for tile in raising[far[raising] <= limit[box]]:
                steps = np.arange(ground_first[tile], ground_last[tile]) % 2048
                horizon[steps] = np.maximum(horizon[steps], bottom[tile])
            expected[box] = (horizon[np.arange(first[box], last[box]) % 2048] > most[box]).all()
        np.testing.assert_array_equal(hidden, expected)


def test_channels_times_the_share_are_rounded() -> None:
    channel, share = (each.ravel() for each in np.indices((256, 256)))
    texels = np.column_stack([channel, 255 - channel, channel, share]).astype(np.uint8)
    result = np.zeros_like(texels)
    host_function("premultiply")(texels, result)
    np.testing.assert_array_equal(result[:, :3], np.rint(texels[:, :3] * (share[:, None] / 255.0)))
    np.testing.assert_array_equal(result[:, 3], share)


def polygons(corners: np.ndarray, count: np.ndarray) -> np.ndarray:
    return np.array([shapely.Polygon(each[:n]) for each, n in zip(corners, count, strict=True)])


def test_pieces_of_strokes_are_divided_along_bisectors() -> None:
    point, first, reach, owner, place, corners, count, frame, length, along = called("stroke_pieces", 60)
    for k, found in enumerate(polygons(corners, count)):
        line = point[first[owner[k]] : first[owner[k] + 1]]
        a, b = line[place[k]], line[min(place[k] + 1, len(line) - 1)]
        wide = reach[owner[k]]
        assert length[k] == np.hypot(*(b - a))
        assert along[k] == pytest.approx(np.hypot(*np.diff(line[: place[k] + 1], axis=0).T).sum())
        forward = (b - a) / length[k] if length[k] else np.array([1.0, 0.0])
        np.testing.assert_allclose(frame[k], [*a, *forward], rtol=1e-12)
        left = np.array([-forward[1], forward[0]])
        start, stop, left = a - wide * forward, b + wide * forward, wide * left
        expected = shapely.Polygon([start - left, stop - left, stop + left, start + left])
        for end, other, sign in ((a, place[k] - 1, -1.0), (b, place[k] + 2, 1.0)):
            if not 0 <= other < len(line) or not length[k]:
                continue
            away = sign * (line[other] - end) / np.hypot(*(line[other] - end))
            normal = sign * (forward + away)
            if normal @ normal > 1e-9:
                normal, across = 1e4 * normal, 1e4 * np.array([-normal[1], normal[0]])
                half = [end + across, end - across, end - across - normal, end + across - normal]
                expected = shapely.intersection(expected, shapely.Polygon(half), grid_size=GRID)
        assert shapely.hausdorff_distance(found, expected) < 1e-6, k


def test_cells_that_polygons_meet_are_found() -> None:
    for size in (2, 20):
        corners, count, border, side, *found = SAMPLES["cells_met"](size)
        corners = corners + 0.013  # so that none only touches a cell
        met = host_function("cells_met")(corners, count, border, side, *found)
        pairs = [[], []]
        row, column = (each.ravel() for each in np.indices((side, side)))
        for k, polygon in enumerate(polygons(corners, count)):
            wide = border[k]
            cells = shapely.box(column - wide, row - wide, column + 1 + wide, row + 1 + wide)
            pairs[0] += np.flatnonzero(shapely.intersects(cells, polygon)).tolist()
            pairs[1] += [k] * (len(pairs[0]) - len(pairs[1]))
        assert met == len(pairs[0])
        for one, expected in zip(found, pairs, strict=True):
            np.testing.assert_array_equal(one[:met], expected[: len(one)])


def test_cut_polygons_cover_what_they_share_with_triangles() -> None:
    for size in (2, 12):
        arguments = SAMPLES["cut_polygons"](size)
        corners, count, _, _, mesh, *_, triangle, part, column, row = arguments
        met = host_function("cut_polygons")(*arguments)
        assert 0 < met <= len(row)
        assert met % 3 == 0
        fans = np.column_stack([column, row])[:met].reshape(-1, 3, 2)
        (px, py), (qx, qy) = (fans[:, 1] - fans[:, 0]).T, (fans[:, 2] - fans[:, 0]).T
        key = part[:met:3] * len(mesh) + triangle[:met:3]
        area = np.bincount(key, 0.5 * np.abs(px * qy - py * qx), minlength=len(count) * len(mesh))
        shared = shapely.intersection(
            polygons(corners, count)[:, None], shapely.polygons(mesh)[None], grid_size=GRID
        )
        np.testing.assert_allclose(area.reshape(shared.shape), shapely.area(shared), atol=1e-6)
        room = met // 2
        few = [*arguments[:8], *np.zeros((2, room), np.int64), *np.zeros((2, room))]
        assert host_function("cut_polygons")(*few) == met
        np.testing.assert_array_equal(few[-1], row[:room])


def test_loops_over_nothing_write_nothing() -> None:
    none, integers = np.zeros(0), np.zeros(0, np.int64)
    pieces, first = np.zeros((0, 16, 2)), np.zeros(1, np.int64)
    host_function("stroke_pieces")(
        np.zeros((0, 2)), first, none, integers, integers, pieces, integers, np.zeros((0, 4)), none, none
    )
    assert host_function("cells_met")(pieces, integers, none, 3, integers, integers) == 0
    mesh = np.zeros((0, 3, 2)), first, integers, integers
    outputs = integers, integers, none, none
    assert host_function("cut_polygons")(pieces, integers, integers, integers, *mesh, *outputs) == 0
    for name in ("evaluate_surface", "compute_tops"):
        arguments, again = SAMPLES[name](5), SAMPLES[name](5)
        at = 22 if name == "evaluate_surface" else 13  # begin and end
        host_function(name)(*arguments[:at], 2, 2, *arguments[at + 2 :])
        for one, other in zip(arguments, again, strict=True):
            assert name == "compute_tops" or np.array_equal(one, other, equal_nan=True)
