"""Parts of a map on grounds whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.export.map_contours import choose_interval, simplified, trace
from sketchterrain.export.map_frame import Frame
from sketchterrain.export.map_ground import MapGround
from sketchterrain.export.map_labels import Room, corners_of, discs_of
from sketchterrain.export.map_peaks import prominences
from sketchterrain.export.map_png import FINER, pixels_of
from sketchterrain.export.map_relief import relief_picture
from sketchterrain.export.map_sheet import Areas, Layer, Lines, Sheet, Words, text_width
from sketchterrain.export.map_water import shore_of

FRAME = Frame(10.0, 20.0, 1000.0, 1000.0, 5000.0)


def ground(height: np.ndarray, depth: np.ndarray | None = None) -> MapGround:
    height = np.asarray(height, np.float32)
    spacing = 1000.0 / (len(height) - 1)
    cover = np.zeros((*height.shape, 8), np.float32)
    cover[..., 0] = 1.0
    dry = np.full(height.shape, -1.0, np.float32)
    return MapGround((spacing, spacing), height, height, spacing, dry if depth is None else depth, cover)


def places(side: int = 201) -> tuple[np.ndarray, np.ndarray]:
    x = np.linspace(0.0, 1000.0, side)
    return x[None, :], x[::-1, None]


def test_contours_of_a_cone_are_circles() -> None:
    x, y = places()
    distance = np.hypot(x - 500.0, y - 500.0)
    for contour in trace(ground(200.0 - 0.4 * distance), FRAME, 20.0):
        radius = np.hypot(*(contour.places - 500.0).T)
        assert radius == pytest.approx((200.0 - contour.height) / 0.4, abs=1.0)


def test_the_interval_follows_steepness_and_scale() -> None:
    x, y = places()
    steep, gentle = ground(0.9 * x + 0.0 * y), ground(0.1 * x + 0.0 * y)
    assert choose_interval(steep, 25_000.0) == 20.0  # what Alpine maps of that scale have
    assert choose_interval(gentle, 25_000.0) == 2.0
    assert choose_interval(steep, 100_000.0) == 50.0
    assert choose_interval(ground(0.0 * x + 0.0 * y), 25_000.0) > 0.0


def test_what_is_left_out_of_a_path_lies_on_it() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 2000)
    circle = 30.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    few = simplified(circle, 0.02)
    assert len(few) < 200
    assert (few[[0, -1]] == circle[[0, -1]]).all()
    middles = 0.5 * (few[1:] + few[:-1])
    assert np.abs(np.hypot(*middles.T) - 30.0).max() < 0.1


def test_prominence_is_the_way_down_to_a_higher_summit() -> None:
    row = np.array([0.0, 5.0, 2.0, 9.0, 4.0, 7.0, 1.0])
    found = prominences(np.tile(row, (1, 1)))
    assert [(p, c) for p, _, c in found] == [(9.0, 3), (3.0, 1), (3.0, 5)]
    x, y = places(41)
    hills = 90.0 * np.exp(-(((x - 250.0) / 90) ** 2) - ((y - 250.0) / 90) ** 2)
    hills = hills + 60.0 * np.exp(-(((x - 750.0) / 90) ** 2) - ((y - 750.0) / 90) ** 2)
    first, second = prominences(hills)[:2]
    assert first == (pytest.approx(90.0, abs=0.1), 30, 10)
    assert second[0] == pytest.approx(60.0, abs=1.0)
    assert second[1:] == (10, 30)


def test_room_is_given_once_and_only_on_the_map() -> None:
    room = Room((0.0, 0.0, 100.0, 50.0))
    label = Words("123", 50.0, 25.0, 2.0, (0, 0, 0), "middle", 30.0)
    discs = discs_of(label, air=0.5)
    assert room.free(discs)
    room.take(discs)
    assert not room.free(discs)
    assert room.free(discs + np.array([10.0, 0.0, 0.0]))
    assert not room.free(discs + np.array([49.0, 0.0, 0.0]))
    # The discs lie on the text, whichever way it is turned.
    box = corners_of(label, air=0.0)
    assert box.mean(axis=0) == pytest.approx([50.0, 25.0])
    assert np.hypot(*(box[1] - box[0])) == pytest.approx(label.width)
    assert text_width("123123", 2.0) == pytest.approx(2.0 * text_width("123", 2.0), rel=0.1)


def test_shores_close_at_the_maps_border() -> None:
    x, y = places()
    depth = (100.0 - np.hypot(x, y - 500.0)).astype(np.float32)  # half a disc at the western border
    (ring,) = shore_of(ground(0.0 * depth, depth), FRAME)
    area = 0.5 * abs(np.sum(ring[:, 0] * np.roll(ring[:, 1], -1) - ring[:, 1] * np.roll(ring[:, 0], -1)))
    assert area == pytest.approx(0.5 * np.pi * 20.0**2, rel=0.05)


def test_slopes_to_the_north_west_are_lighter_and_flat_ground_is_even() -> None:
    x, y = places(101)
    flat = relief_picture(ground(0.0 * x + 0.0 * y)).astype(int)
    assert np.ptp(flat.reshape(-1, 3), axis=0).max() == 0
    cone = relief_picture(ground(200.0 - 0.4 * np.hypot(x - 500.0, y - 500.0))).astype(int).sum(axis=-1)
    assert cone[25, 25] > cone[75, 75] + 60


def test_a_sheet_is_drawn_where_its_shapes_lie() -> None:
    black = (0, 0, 0)
    ring = np.array([[2.0, 2.0], [8.0, 2.0], [8.0, 8.0], [2.0, 8.0]])
    hole = 0.5 * (ring - 5.0) + 5.0
    layers = [
        Layer("areas", [Areas([ring, hole], (200, 0, 0))]),
        Layer("half", [Areas([ring + np.array([10.0, 0.0])], black, 0.5)]),
        Layer("lines", [Lines([np.array([[0.0, 15.0], [30.0, 15.0]])], black, 2.0)], (0.0, 10.0, 10.0, 10.0)),
    ]
    picture = pixels_of(Sheet("x", 20.0, 20.0, layers), width=200).astype(int)
    assert picture.shape == (200, 200, 3)
    assert picture[30, 30].tolist() == [200, 0, 0]
    assert picture[50, 50].tolist() == [255, 255, 255]  # the hole
    assert picture[50, 150] == pytest.approx([127, 127, 127], abs=2)
    assert picture[150, 50].tolist() == [0, 0, 0]
    assert picture[150, 150].tolist() == [255, 255, 255]  # clipped
    assert (picture[:, 50, 0] < 128).sum() == pytest.approx(20, abs=1)  # 2 mm
    assert FINER >= 3


def test_turned_text_reads_clockwise() -> None:
    sheet = Sheet("x", 20.0, 20.0, [Layer("a", [Words("III", 10.0, 10.0, 4.0, (0, 0, 0), "start", 90.0)])])
    dark = 255 - pixels_of(sheet, width=200).mean(axis=-1)
    row, column = (np.average(axis, weights=dark) for axis in np.mgrid[:200, :200])
    assert row > 105  # it goes down from its anchor
    assert column == pytest.approx(100, abs=4)
