"""A map says of a terrain what the terrain is."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from PIL import Image

import sketchterrain as st
from sketchterrain.errors import InputError
from sketchterrain.export import write_map, write_sheet
from sketchterrain.export.map import map_sheet
from sketchterrain.export.map_contour_lines import PENS, WIDTHS
from sketchterrain.export.map_contours import INDEX, choose_interval, find_levels, trace
from sketchterrain.export.map_frame import Frame, frame_of, round_number
from sketchterrain.export.map_ground import sample_ground
from sketchterrain.export.map_sheet import Areas, Lines, Picture, Words
from sketchterrain.export.map_svg import svg_of
from sketchterrain.export.map_water import BANK, FOREST, WATER
from sketchterrain.terrain.water import standing_water

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.export.map_ground import MapGround
    from sketchterrain.export.map_sheet import Sheet

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def terrain() -> st.Terrain:
    """A mountain, a river from the west, a lake and a wood, on a sketch wider than high."""
    mountain, river, forest, lake = (np.zeros((48, 64), np.uint8) for _ in range(4))
    mountain[4:18, 44:60] = 1
    river[24:27, :34] = 1
    forest[34:46, 6:26] = 1
    lake[33:42, 40:52] = 1
    return st.build(
        st.Sketch(
            name="A & <B>",
            extent=4096.0,
            seed=5,
            ground={"relief": 20.0},
            density={"hill": 0.3},
            layers={"mountain": mountain, "river": river, "forest": forest, "lake": lake},
            labels={("mountain", 1): {"height": 500.0}, ("river", 1): {"width": 30.0}},
        )
    )


@pytest.fixture(scope="module")
def frame(terrain: st.Terrain) -> Frame:
    return frame_of(terrain.size)


@pytest.fixture(scope="module")
def ground(terrain: st.Terrain, frame: Frame) -> MapGround:
    return sample_ground(terrain, frame)


@pytest.fixture(scope="module")
def sheet(terrain: st.Terrain) -> Sheet:
    return map_sheet(terrain)


def layer(sheet: Sheet, name: str) -> list[object]:
    return next(list(each.shapes) for each in sheet.layers if each.name == name)


def words(sheet: Sheet) -> list[str]:
    return [shape.text for each in sheet.layers for shape in each.shapes if isinstance(shape, Words)]


def metres(frame: Frame, path: np.ndarray) -> np.ndarray:
    x = (path[:, 0] - frame.left) / frame.metre
    return np.stack([x, frame.north - (path[:, 1] - frame.top) / frame.metre], axis=-1)


def around(terrain: st.Terrain, ground: MapGround, places: np.ndarray, reach: float) -> np.ndarray:
    """Return the lowest and the highest ground (m) within a distance (m) of places."""
    angle = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    off = reach * np.concatenate([[[0.0, 0.0]], np.stack([np.cos(angle), np.sin(angle)], axis=-1)])
    near = np.clip(places[:, None] + off, 0.0, terrain.size)
    heights = terrain.heights(near[..., 0], near[..., 1], cell_size=ground.cell_size)
    return np.stack([heights.min(axis=1), heights.max(axis=1)])


def test_a_frame_has_a_round_scale_and_north_up(frame: Frame) -> None:
    for size in ((6144.0, 6144.0), (16384.0, 8192.0), (1.0, 1.0), (200.0, 1e6), (1e6, 17.0)):
        fitted = frame_of(size)
        *_, width, height = fitted.box
        assert max(width, height) <= 275.0 + 1e-6
        assert max(width, height) > 180.0
        assert fitted.sheet_width >= 160.0
        assert fitted.scale / 10 ** np.floor(np.log10(fitted.scale)) in (
            1,
            1.25,
            1.5,
            2,
            2.5,
            3,
            4,
            5,
            6,
            7.5,
            8,
        )
    assert frame_of((6144.0, 6144.0)).scale == 25_000

    left, top, width, height = frame.box
    corners = frame.place([[0.0, 0.0], [4096.0, 0.0], [0.0, 3072.0]])
    assert corners == pytest.approx(
        np.array([[left, top + height], [left + width, top + height], [left, top]])
    )
    # A millimetre of paper is `scale` millimetres of ground.
    apart = frame.place([100.0, 0.0])[0] - frame.place([0.0, 0.0])[0]
    assert apart * frame.scale == pytest.approx(100.0 * 1000.0)

    for number, nearest, above in [(1.0, 1, 1), (1.3, 1, 2), (3.3, 5, 5), (0.07, 0.05, 0.1)]:
        steps = (1.0, 2.0, 5.0)
        assert round_number(number, steps=steps) == pytest.approx(nearest), number
        assert round_number(number, steps=steps, up=True) == pytest.approx(above), number


def test_contours_run_where_the_ground_has_their_height(
    terrain: st.Terrain, ground: MapGround, frame: Frame
) -> None:
    interval = choose_interval(ground, frame.scale)
    assert interval in (5.0, 10.0, 20.0)
    contours = trace(ground, frame, interval)
    assert len({contour.height for contour in contours}) > 20
    assert all(contour.index == (round(contour.height / interval) % INDEX == 0) for contour in contours)
    places = np.concatenate([contour.places for contour in contours])
    level = np.concatenate([np.full(len(contour.places), contour.height) for contour in contours])
    # No more than a tenth of a millimetre off on the sheet; in the median nearly not at all.
    low, high = around(terrain, ground, places, 0.1 / frame.metre)
    assert ((low <= level) & (level <= high)).all()
    height = terrain.heights(*places.T, cell_size=ground.cell_size)
    assert np.median(np.abs(height - level)) < 0.01 * interval

    levels = np.array(find_levels(ground, 10.0))
    assert (levels % 10.0 == 0.0).all()
    assert ground.even.min() < levels[0] <= ground.even.min() + 10.0
    assert ground.even.max() - 10.0 <= levels[-1] < ground.even.max()


def test_drawn_contours_are_still_there_and_none_lies_on_a_lake(
    terrain: st.Terrain, ground: MapGround, frame: Frame, sheet: Sheet
) -> None:
    interval = choose_interval(ground, frame.scale)
    lines = layer(sheet, "contours")
    assert {line.colour for line in lines} <= set(PENS.values())
    assert {line.width for line in lines} == set(WIDTHS.values())
    paths = [metres(frame, path) for line in lines for path in line.paths]
    places, ends = np.concatenate(paths), np.cumsum([len(path) for path in paths])[:-1]
    height = terrain.heights(*places.T, cell_size=ground.cell_size)
    own = [float(np.median(part)) for part in np.split(height, ends)]
    level = np.repeat(interval * np.rint(np.array(own) / interval), [len(path) for path in paths])
    low, high = around(terrain, ground, places, 0.15 / frame.metre)
    assert ((low <= level) & (level <= high)).all()
    x, y = np.array([path[len(path) // 2] for path in paths]).T
    assert not standing_water(terrain.recipe, "lake", x, y, terrain.heights(x, y)).any()


def test_rivers_are_drawn_along_their_centrelines(terrain: st.Terrain, frame: Frame, sheet: Sheet) -> None:
    drawn = [
        path
        for shape in layer(sheet, "rivers")
        if isinstance(shape, Lines) and shape.colour in (BANK, WATER)
        for path in shape.paths
    ]
    along = np.linspace(0.0, 1.0, 400)[:, None]
    pieces = [(start, end) for path in drawn for start, end in itertools.pairwise(path)]
    points = np.concatenate([start + along * (end - start) for start, end in pieces])
    river = max(terrain.features.rivers, key=lambda each: len(each.centreline))
    inside = ((river.centreline[:, :2] > 0.0) & (river.centreline[:, :2] < terrain.size)).all(axis=1)
    x, y = river.centreline[inside, :2].T
    dry = ~standing_water(terrain.recipe, "lake", x, y, terrain.heights(x, y))
    for place in frame.place(river.centreline[inside][dry])[::7]:
        assert np.hypot(*(points - place).T).min() < 0.15  # mm
    width = max(shape.width for shape in layer(sheet, "rivers") if isinstance(shape, Lines))
    assert width == pytest.approx(30.0 * frame.metre, abs=0.6)


def test_lakes_are_drawn_where_water_stands(terrain: st.Terrain, frame: Frame, sheet: Sheet) -> None:
    shore = next(shape for shape in layer(sheet, "lakes") if isinstance(shape, Areas)).rings
    lake = terrain.features.lakes[0]
    for ring in shore:
        height = terrain.heights(*metres(frame, ring).T)
        assert np.median(np.abs(height - lake.level)) < 1.5
    level = f"{lake.level:.0f}"
    assert level in [shape.text for shape in layer(sheet, "labels") if isinstance(shape, Words)]


def test_the_highest_summit_has_its_height(terrain: st.Terrain, sheet: Sheet) -> None:
    heights = [int(shape.text) for shape in layer(sheet, "labels") if isinstance(shape, Words) and shape.halo]
    x = np.linspace(0.0, terrain.size[0], 700)
    y = np.linspace(0.0, terrain.size[1], 500)
    highest = float(terrain.heights(x[None], y[:, None]).max())
    assert max(heights) == pytest.approx(highest, abs=6.0)


def test_labels_keep_off_each_other_and_off_the_border(frame: Frame, sheet: Sheet) -> None:
    left, top, width, height = frame.box
    labels = [shape for shape in layer(sheet, "labels") if isinstance(shape, Words)]
    assert len(labels) > 10
    middles = []
    for label in labels:
        start = {"start": 0.5, "middle": 0.0, "end": -0.5}[label.anchor] * label.width
        turn = np.radians(label.turn)
        middles.append((label.x + start * np.cos(turn), label.y + start * np.sin(turn)))
        assert left < middles[-1][0] < left + width
        assert top < middles[-1][1] < top + height
    place = np.array(middles)
    apart = np.hypot(*(place[:, None] - place[None]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    assert apart.min() > 1.5


@pytest.mark.slow
def test_the_legend_lists_what_is_on_the_sheet(terrain: st.Terrain, sheet: Sheet, tmp_path: Path) -> None:
    told = words(sheet)
    assert {"River, flow", "Forest", "Lake, water level (m)", "Summit, height (m)", "N"} <= set(told)
    assert any(shape.colour == FOREST for shape in layer(sheet, "forests") if isinstance(shape, Areas))
    assert f"1 : {frame_of(terrain.size).scale:,.0f}".replace(",", " ") in told
    bare = st.build(
        st.Sketch(name="Flat", extent=1000.0, ground={"relief": 0.0}, density={"hill": 0.0, "mountain": 0.0})
    )
    written = ET.fromstring(write_map(tmp_path / "map.svg", bare)[0].read_text())  # noqa: S314 - written here
    plain = [str(each.text) for each in written.iter(f"{SVG}text")]
    assert "N" in plain
    assert not {"River, flow", "Forest", "Lake, water level (m)", "Summit, height (m)"} & set(plain)
    assert "Snow" not in plain


def test_an_svg_has_vectors_and_letters_and_one_picture(sheet: Sheet) -> None:
    text = svg_of(sheet)
    assert len(text) < 4_000_000
    root = ET.fromstring(text)  # noqa: S314 - written here
    assert root.get("width") == f"{sheet.width:.2f}".rstrip("0").rstrip(".") + "mm"
    assert len(list(root.iter(f"{SVG}image"))) == 1
    assert len(list(root.iter(f"{SVG}path"))) > 20
    assert [each.text for each in root.iter(f"{SVG}text")] == words(sheet)
    assert [each.get("id") for each in root.findall(f"{SVG}g")] == [each.name for each in sheet.layers]
    assert svg_of(sheet) == text


@pytest.mark.slow
def test_the_same_terrain_gives_the_same_map(terrain: st.Terrain, sheet: Sheet, tmp_path: Path) -> None:
    for name in ("a.png", "a.svg"):
        write_sheet(tmp_path / name, sheet, size=(500, 5000))
        write_map(tmp_path / f"b{name[1:]}", terrain, size=(500, 5000))
        assert (tmp_path / name).read_bytes() == (tmp_path / f"b{name[1:]}").read_bytes()


def test_a_png_has_the_asked_size_and_a_blue_lake(sheet: Sheet, tmp_path: Path) -> None:
    write_sheet(tmp_path / "a.png", sheet, size=(500, 5000))
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (500, round(500 * sheet.height / sheet.width))
        pixels = np.asarray(image)
    # The lake is blue, in the picture as on the sheet.
    lake = next(shape for shape in layer(sheet, "lakes") if isinstance(shape, Areas)).rings[0]
    column, row = (lake.mean(axis=0) * 500 / sheet.width + [4, 4]).astype(int)
    red, _, blue = pixels[row, column].astype(int)
    assert blue > red + 20


def test_the_relief_picture_covers_the_frame_and_other_files_are_refused(
    sheet: Sheet, frame: Frame, terrain: st.Terrain, tmp_path: Path
) -> None:
    (picture,) = layer(sheet, "relief")
    assert isinstance(picture, Picture)
    rows, columns = picture.pixels.shape[:2]
    left, _, width, _ = picture.box
    # The first and the last sample lie on the map's borders: half a pixel within.
    assert left + 0.5 * width / columns == pytest.approx(frame.left)
    assert width * (columns - 1) / columns == pytest.approx(frame.box[2])
    assert abs(rows / columns - 0.75) < 0.01

    with pytest.raises(InputError, match=r"a \.png or \.svg file for a map, got 'a\.pdf'"):
        write_map(tmp_path / "a.pdf", terrain)
