"""Scattered places: where they lie, and which of them an eye needs."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.render import Camera
from sketchterrain.render.scatter import (
    BAND,
    Nearby,
    Strewing,
    away_from,
    cells_within,
    hashed,
    in_sight,
    places_of,
)

from .test_shaders import evaluate

STREWING = Strewing(salt=7, density=20.0, full=6.0, reach=80.0, cell=4.0, details=(10.0, 30.0))
EYES = [(3.2, -7.9, 2.0), (-1e6 + 0.3, 4e6 + 3.1, 55.0)]
INCLUDES = ["render/scatter.glsl"]
STEP = (3242174889, 2447445414)
JITTER = 0.52


def unit(h):
    return (h >> np.uint32(8)).astype(np.float64) / 2.0**24


def strewn(seed, rank):
    """The oracle of scatter.glsl's function."""
    seed, rank = np.uint32(seed), np.uint32(rank)
    with np.errstate(over="ignore"):
        h = hashed(seed ^ (rank * np.uint32(0x9E3779B9) + np.uint32(0x7F4A7C15)))
        turned = [
            hashed(seed + np.uint32(k)) + (rank + np.uint32(1)) * np.uint32(step)
            for k, step in enumerate(STEP)
        ]
        shaken = [unit(hashed(h + np.uint32(k + 1))) - 0.5 for k in range(2)]
    spread = JITTER / np.sqrt(rank.astype(np.float64) + 1.0)
    return np.stack([np.mod(unit(t) + spread * s, 1.0) for t, s in zip(turned, shaken, strict=True)], axis=-1)


def seeds_and_ranks():
    rng = np.random.default_rng(3)
    return rng.integers(0, 2**32, 300, dtype=np.uint32), rng.integers(0, 2000, 300).astype(np.uint32)


@pytest.mark.gl
def test_places_and_presence_in_the_shader_are_those_of_the_oracle(gl):
    seed, rank = seeds_and_ranks()
    whole = "uint(a.x) * 65536u + uint(a.y)"
    halves = np.c_[seed >> 16, seed & 0xFFFF, rank, np.zeros(300)]
    got = evaluate(gl, INCLUDES, f"vec4(strewn({whole}, uint(a.z)), 0.0, 0.0)", halves)[:, :2]
    off = np.abs(got - strewn(seed, rank))
    assert np.minimum(off, 1.0 - off).max() < 1e-6

    rng = np.random.default_rng(4)
    rank, away = rng.integers(0, 320, 400), rng.uniform(0.0, 90.0, 400)
    got = evaluate(
        gl, INCLUDES, "vec4(presence(uint(a.x), 320.0, a.y, 6.0, 80.0))", np.c_[rank, away, away, away]
    )[:, 0]
    share = 6.0 / np.maximum(away, 6.0)
    up = np.clip((share * (1.0 + BAND) - (rank + 0.5) / 320.0) / (BAND * share), 0.0, 1.0)
    expected = up * np.clip((80.0 - away) / (0.35 * 80.0), 0.0, 1.0)
    np.testing.assert_allclose(got, expected, atol=2e-4)


def test_every_beginning_of_a_cells_order_is_spread_evenly():
    for count in (16, 60, 200):
        gaps = []
        for seed in np.random.default_rng(5).integers(0, 2**32, 40, dtype=np.uint32):
            places = strewn(np.full(count, seed), np.arange(count))
            away = np.abs(places[:, None] - places[None])
            away = np.hypot(*np.moveaxis(np.minimum(away, 1.0 - away), -1, 0)) + 2.0 * np.eye(count)
            gaps.append(away.min(axis=1).mean())
        assert np.mean(gaps) > 0.62 / np.sqrt(count)  # at random 0.5, on a square lattice 1


def test_a_place_is_the_same_for_every_eye():
    for eye in EYES:
        near = np.add(eye, [0.5, -0.3, 0.1])
        found = []
        for each in (eye, near):
            cells = cells_within(each, STREWING.reach, STREWING.cell)
            rows = places_of(STREWING, cells, each, 1.7).rows
            corner = rows["corner"] + np.asarray(each[:2])
            names = np.round(corner / STREWING.cell).astype(int)
            keys = list(zip(*names.T.tolist(), rows["rank"].tolist(), strict=True))
            found.append(dict(zip(keys, zip(rows["seed"].tolist(), corner, strict=True), strict=True)))
        both = found[0].keys() & found[1].keys()
        assert len(both) > 0.9 * len(found[0])
        for key in list(both)[::50]:
            assert found[0][key][0] == found[1][key][0]
            np.testing.assert_allclose(
                found[0][key][1], found[1][key][1], atol=1e-2 if abs(eye[0]) > 1e5 else 1e-4
            )


def test_all_present_places_are_requested_in_order_of_distance():
    eye = EYES[0]
    cells = cells_within(eye, STREWING.reach, STREWING.cell)
    places = places_of(STREWING, cells, eye, 0.0)
    asked = np.zeros(len(cells), int)
    code = {tuple(cell): k for k, cell in enumerate(cells.tolist())}
    corner = np.round((places.rows["corner"] + np.asarray(eye[:2])) / STREWING.cell).astype(int)
    for cell in corner.tolist():
        asked[code[tuple(cell)]] += 1
    nearest = away_from(eye, cells, STREWING.cell)
    share = STREWING.full / np.maximum(nearest, STREWING.full)
    present = (np.arange(STREWING.room) + 0.5) / STREWING.room < share[:, None] * (1.0 + BAND)
    assert (asked >= present.sum(axis=1)).all()
    assert asked.sum() < 1.1 * present.sum()

    eye = EYES[0]
    cells = cells_within(eye, STREWING.reach, STREWING.cell)
    places = places_of(STREWING, cells, eye, 0.0)
    assert places.counts.sum() == len(places.rows)
    corner = places.rows["corner"] + STREWING.cell / 2
    away = np.hypot(*np.maximum(np.abs(corner) - STREWING.cell / 2, 0.0).T)
    ends = np.cumsum(places.counts)
    assert away[: ends[0]].max() < 10.0 + 1e-3
    assert away[ends[0] : ends[1]].min() >= 10.0 - 1e-3
    assert away[ends[1] :].min() >= 30.0 - 1e-3
    assert len(places_of(STREWING, cells, eye, 100.0).rows) == 0  # from so high nothing is near


def test_cells_in_sight_are_never_left_out():
    eye = (10.0, 20.0, 31.7)
    camera = Camera(eye, (40.0, 45.0, 30.0))
    cells = cells_within(eye, 60.0, 4.0)
    seen = {tuple(cell) for cell in cells[in_sight(camera.frustum(1.5), cells, 4.0, eye, 1.7)].tolist()}
    rng = np.random.default_rng(8)
    places = rng.uniform(-40.0, 40.0, (4000, 2)) + eye[:2]
    away = np.hypot(*(places - eye[:2]).T)
    up = 30.0 + rng.uniform(-1.2, 1.2, 4000) * away
    clip = np.c_[places - eye[:2], up - eye[2], np.ones(4000)] @ camera.to_clip(1.5).T
    visible = (np.abs(clip[:, :2]) < clip[:, 3:]).all(axis=1) & (clip[:, 3] > 0.2)
    cells_of = np.floor(places[visible] / 4.0).astype(int)
    assert {tuple(cell) for cell in cells_of.tolist()} <= seen
    assert len(seen) < 0.5 * len(cells)


def test_places_are_found_again_only_for_another_view():
    nearby, again = Nearby(STREWING), Nearby(STREWING)
    camera, other = (
        Camera((10.0, 20.0, 31.7), (40.0, 45.0, 30.0)),
        Camera((10.0, 20.1, 31.7), (40.0, 45.0, 30.0)),
    )
    places = nearby.seen(camera, 1.5, 1.7)
    assert nearby.seen(camera, 1.5, 1.7) is places
    for view in ((other, 1.5, 1.7), (camera, 1.2, 1.7), (camera, 1.5, 9.0)):
        moved = nearby.seen(*view)
        assert moved is not places
        assert moved.rows.tobytes() == again.seen(*view).rows.tobytes()
