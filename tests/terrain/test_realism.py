"""Realism: metrics on ground whose metrics are known, comparison with real land, and fakes."""

import heapq
import math

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.errors import InputError
from sketchterrain.landforms.flow_routing import route_flow
from sketchterrain.measure.realism import (
    compare,
    interpolate_across,
    kinds_of_land,
    measure_realism,
    measure_terrain_realism,
    nearest_land,
)
from sketchterrain.measure.realism_metrics import (
    FORMS,
    geomorphons,
    measure_window_maps,
    spectral_slopes,
)
from tests import terrains

STORED = """
relief_m 841.2228, g_flat 0, g_peak 0.010625, g_ridge 0.0709375, g_shoulder 0, g_spur 0.241875,
g_slope 0.3646875, g_hollow 0.1892187, g_footslope 0, g_valley 0.1017187, g_pit 0.0209375,
ridge_extent 0.3561808, valley_extent 0.3129857, slope_p05 8.035841, slope_p25 16.48002,
slope_p50 24.34239, slope_p75 33.22278, slope_p95 42.71487, slope_p99 47.35529, level_share 0.02142334,
middle_share 0.5548096, high_low_slope 0.3941754, hypsometric 0.455014, relief_growth 0.888607,
quiet_share 0, spectrum_coarse 7.517604, spectrum_fine 7.933059, skin 0.2528648, curvature_skew 0.0678588,
sink_share 0.1054077, sink_depth 0.006625071, channel_in_valley 0.6793893, channel_off_slope 0.3206107,
concavity 0.9297991, concavity_r2 0.4669954, hack 0.3226418, bifurcation 6.041523, length_ratio 1.459257,
sinuosity 1.080569, uphill 0.1502038, largest_basins 0.7090454, valley_depth 0.7520326, summits 6.713867,
saddle_height 0.8613274
"""

SIDE, CELL = 128, 30.0
Y, X = np.mgrid[:SIDE, :SIDE].astype(float)


def measure_window(*window):
    return measure_window_maps(*window)[0]


def fbm(seed, exponent, side=SIDE):
    """Noise with the power spectrum k^-exponent, scaled to 35° at its steepest 5 %."""
    k = np.hypot(np.fft.fftfreq(2 * side)[:, None], np.fft.fftfreq(2 * side))
    k[0, 0] = 1.0
    white = np.fft.fft2(np.random.default_rng(seed).normal(size=(2 * side, 2 * side)))
    z = np.fft.ifft2(white * k ** (-exponent / 2.0)).real[:side, :side]
    slope = np.hypot(*np.gradient(z, CELL))
    return z * math.tan(math.radians(35.0)) / np.percentile(slope, 95)


def breached(z):
    """Cut a way out of every depression, along the way that a flood takes in."""
    z, done = z.copy(), np.zeros(z.shape, bool)
    done[0], done[-1], done[:, 0], done[:, -1] = (True,) * 4
    heap = [(z[at], *at, -1, -1) for at in zip(*np.nonzero(done), strict=True)]
    heapq.heapify(heap)
    parent = {}
    while heap:
        level, i, j, p, q = heapq.heappop(heap)
        parent[i, j] = (p, q)
        height = z[i, j]
        while p >= 0 and z[p, q] >= height:
            height -= 1e-4
            z[p, q] = height
            p, q = parent[p, q]
        for a, b in ((i + k // 3 - 1, j + k % 3 - 1) for k in range(9)):
            if 0 <= a < z.shape[0] and 0 <= b < z.shape[1] and not done[a, b]:
                done[a, b] = True
                heapq.heappush(heap, (max(level, z[a, b]), a, b, i, j))
    return z


def steady_state(rounds=12):
    """A stream-power steady state, S = 3 A^-0.45, on a square that is lowered along its border."""
    z = np.random.default_rng(5).uniform(0.0, 1.0, (SIDE, SIDE))
    for _ in range(rounds):
        flow = route_flow(z, CELL)
        height = np.zeros(z.size)
        for cell in flow.order:
            to = flow.receiver[cell]
            if to >= 0:
                height[cell] = height[to] + 3.0 * flow.area[cell] ** -0.45 * flow.step[cell] * CELL
        z = height.reshape(z.shape)
    return z


def test_plane_has_one_slope_and_no_hollow() -> None:
    found = measure_window(0.1 * CELL * X + 0.001 * Y, CELL)
    assert found["slope_p05"] == pytest.approx(math.degrees(math.atan(0.1)), rel=1e-4)
    assert found["slope_p95"] == pytest.approx(found["slope_p05"], rel=1e-6)
    assert found["hypsometric"] == pytest.approx(0.5, abs=0.01)
    assert found["sink_share"] == found["uphill"] == found["sink_depth"] == 0.0
    assert found["g_slope"] == 1.0


def test_cone_is_a_peak_with_spurs_and_slopes() -> None:
    z = 4000.0 - 20.0 * np.hypot(X - 64.0, Y - 64.0)
    form = geomorphons(z, CELL)
    assert FORMS[form[64, 64]] == "peak"
    assert set(np.unique(form[30:98, 30:98])) <= {
        FORMS.index(name) for name in ("peak", "ridge", "spur", "slope")
    }
    found = measure_window(z, CELL)
    assert found["slope_p50"] == pytest.approx(math.degrees(math.atan(20.0 / CELL)), rel=1e-2)
    assert found["summits"] == pytest.approx(1e4 / z.size) or found["summits"] == 0.0  # none has a saddle
    assert math.isnan(found["saddle_height"])


def test_hollow_has_the_area_and_depth_that_were_dug() -> None:
    z = 3.0 * CELL * 0.1 * X
    pit = np.hypot(X - 64.0, Y - 64.0) < 10.0
    z[pit] -= 200.0
    flow = route_flow(z, CELL)
    spill = z[~pit & ndimage.binary_dilation(pit, np.ones((3, 3)))].min()
    depth = np.maximum(spill - z, 0.0) * pit
    assert (flow.filled - z.ravel()).reshape(z.shape) == pytest.approx(depth, abs=0.01)
    found = measure_window(z, CELL)
    assert found["sink_share"] == pytest.approx((depth > 0.05 * CELL).mean(), abs=2e-4)
    filled = measure_window(flow.filled.reshape(z.shape), CELL)
    assert filled["sink_share"] == filled["uphill"] == 0.0


def test_water_reaches_the_border_and_no_cell_is_lost() -> None:
    flow = route_flow(fbm(1, 3.0), CELL)
    outlets = flow.receiver < 0
    assert flow.area[outlets].sum() == SIDE * SIDE
    assert outlets.sum() == 4 * (SIDE - 1)
    assert np.all(flow.filled[flow.receiver[~outlets]] < flow.filled[~outlets])


def test_spectral_slope_is_that_of_the_noise() -> None:
    for exponent in (2.4, 3.2, 4.0):
        found = [spectral_slopes(fbm(seed, exponent), (48.0, 12.0, 3.0)) for seed in range(4)]
        coarse, fine = np.mean(found, axis=0)
        assert coarse == pytest.approx(exponent, abs=0.6)  # few waves of a window are that long
        assert fine == pytest.approx(exponent, abs=0.15)


def test_steady_state_has_its_concavity() -> None:
    found = measure_window(steady_state(), CELL)
    assert found["concavity"] == pytest.approx(0.45, abs=0.05)
    assert found["concavity_r2"] > 0.97
    assert found["sink_share"] == found["uphill"] == 0.0
    assert found["channel_in_valley"] > 0.8
    assert found["level_steps"] == 0.0


def test_masked_cells_are_no_level_ground() -> None:
    z, sea = steady_state(), np.zeros(X.shape, np.bool_)
    sea[:, :32] = True
    with_sea = np.where(sea, z.min(), z)
    land, found = measure_window(z[:, 32:], CELL), measure_window(with_sea, CELL, sea)
    for name in ("level_share", "slope_p95", "hypsometric"):
        assert found[name] == pytest.approx(land[name], rel=0.05), name
    assert measure_window(with_sea, CELL)["level_share"] > land["level_share"] + 0.1


def test_stored_metrics() -> None:
    """Numbers of an independent implementation for the same raster."""
    z = 300 * np.sin(X / 17 + np.sin(Y / 23)) * np.cos(Y / 29) + 60 * np.sin(X * Y / 400) + 2.0 * X + 3.0 * Y
    found = measure_window(z, CELL)
    for name, value in (row.split() for row in STORED.split(",")):
        assert found[name] == pytest.approx(float(value), rel=1e-4, abs=1e-9), name


def test_real_medians_are_near_and_kinds_are_found() -> None:
    for kind, land in kinds_of_land().items():
        metrics = {name: values[1] for name, values in land["metrics"].items()}
        metrics |= {f"g_{name}": share for name, share in zip(FORMS, land["forms"], strict=True)}
        metrics |= {"reopened_hollows": 0.0, "level_steps": 0.0}
        found = compare(metrics, kind)
        assert found.distance == pytest.approx(0.0, abs=1e-9)
        assert found.passes
        assert found.out_of_range == ()
        assert nearest_land(metrics, (kind,)).kind == kind
        worse = compare(metrics | {"sink_share": 0.9}, kind)
        assert worse.failed == ("sink_share",)
        assert not worse.passes
    with pytest.raises(InputError, match="no kind of land 'moon': expected desert"):
        nearest_land(metrics, ("moon",))


def test_noise_fails_also_filled_or_breached() -> None:
    passing = []
    for seed, exponent in enumerate((3.4, 4.2)):
        raw = fbm(seed, exponent)
        filled = route_flow(raw, CELL).filled.reshape(raw.shape)
        passing.append([nearest_land(measure_window(z, CELL)).passes for z in (raw, filled, breached(raw))])
    assert not np.any(passing)


def test_windows_cover_a_raster_and_water_is_interpolated() -> None:
    z = fbm(3, 4.0, 200)
    found = measure_realism(z, CELL)
    assert [(each.row, each.column) for each in found.windows] == [(0, 0), (0, 8), (8, 0), (8, 8)]
    entry = found.as_dict()
    assert entry["windows"] == 4
    assert entry["distance"] == pytest.approx(found.distance, abs=1e-4)
    assert set(entry["out_of_range"]) <= set(entry["metrics"])
    plane = 2.0 * X + Y
    lake = np.hypot(X - 20.0, Y - 20.0) < 15.0
    assert interpolate_across(np.where(lake, -500.0, plane), lake) == pytest.approx(plane)
    for bad, message in (
        (z[:50], "at least 96"),
        (np.full(z.shape, np.nan), "no window"),
        (z * 0.0, "no window"),
    ):
        with pytest.raises(InputError, match=message):
            measure_realism(bad, CELL)
    with pytest.raises(InputError, match="no window"):
        measure_realism(z, CELL, masked=np.ones(z.shape, bool))


def test_ground_away_from_the_sketch_is_measured_at_its_place() -> None:
    here, away = (measure_terrain_realism(terrains.plain(), offset=(cells * 30.0, 0.0)) for cells in (0, 100))
    assert away.corner[0] - here.corner[0] == pytest.approx(3000.0)
    np.testing.assert_array_equal(here.height[:, 100:], away.height[:, :-100])
