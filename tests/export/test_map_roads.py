"""Roads, railways, buildings and hedges on maps."""

import numpy as np
import pytest

from sketchterrain.export.map.drawing import MapSheet, Polygons, Polylines, sheet_svg
from sketchterrain.export.map.relief import MapFrame
from sketchterrain.export.map.roads import class_of_road, draw_roads, road_legend
from sketchterrain.roads.road_types import BRIDGE, TUNNEL, RoadNetwork
from sketchterrain.schema.layers import INK, LAYERS
from sketchterrain.schema.styles import PIXEL, rgb_from_hex
from tests.sample_roads import make_network, make_road, straight_road

FRAME = MapFrame(10.0, 20.0, 1024.0, 768.0, 10_000.0)  # 0.1 mm a metre


def lines_of(shapes, colour, width=None):
    found = [each for each in shapes if isinstance(each, Polylines) and each.colour == rgb_from_hex(colour)]
    return [each for each in found if width is None or each.width == pytest.approx(width)]


def test_classes_follow_layer_and_width():
    def title(**given):
        return class_of_road(make_road([(0, 0, 0), (9, 0, 0)], **given)).title

    assert title(width=6.0, shoulder=2.5) == "Main road"
    assert title(width=6.0, shoulder=1.0) == "Road"
    assert title(width=5.0, shoulder=0.5) == "Minor road"
    assert title(width=3.0, shoulder=0.3) == "Track"
    assert title(layer="railway", width=4.4) == "Railway"
    assert title(layer="path", width=1.2) == "Path"


def test_roads_are_cased_lines_at_their_positions_and_as_wide_as_the_scale_shows():
    road = next(each.style for each in LAYERS["road"].classes if each.title == "Road")
    shapes = draw_roads(RoadNetwork((straight_road(),)), FRAME)
    (casing,), (fill,) = lines_of(shapes, INK), lines_of(shapes, road["colour"])
    assert shapes.index(casing) < shapes.index(fill)
    assert casing.width == pytest.approx(fill.width + 0.24)
    assert fill.width == pytest.approx(PIXEL * road["width"])  # 6 m are 0.6 mm
    assert fill.paths[0] == pytest.approx(np.array([[20.0, 86.8], [60.0, 86.8], [100.0, 86.8]]))
    large = MapFrame(10.0, 20.0, 1024.0, 768.0, 1000.0)
    (fill,) = lines_of(draw_roads(RoadNetwork((straight_road(),)), large), road["colour"])
    assert fill.width == 6.0


def test_bridges_have_side_lines_and_tunnels_are_dashed():
    network = make_network()
    road = next(each for each in network.roads if each.structure == BRIDGE)
    shapes = draw_roads(RoadNetwork((road,)), FRAME)
    (sides,) = lines_of(shapes, INK, 0.2)
    radius = [np.hypot(*(side - FRAME.to_sheet([300.0, 400.0])).T) for side in sides.paths]
    half = 0.5 * PIXEL * class_of_road(road).style["width"] + 0.3
    assert radius[0] == pytest.approx(10.0 + half)
    assert radius[1] == pytest.approx(10.0 - half)
    tunnel = next(each for each in network.roads if each.structure == TUNNEL)
    (line,) = draw_roads(RoadNetwork((tunnel,)), FRAME)
    assert line.dashes
    svg = sheet_svg(MapSheet("roads", 200.0, 200.0, {"roads": [line]}), embed_font=False)
    assert 'stroke-dasharray="90 90"' in svg


def test_railways_are_dashed_in_their_casing_and_paths_are_dashed():
    network = make_network()
    casing, line = draw_roads(RoadNetwork((network.roads[4],)), FRAME)
    assert (casing.colour, casing.dashes) == (rgb_from_hex(INK), ())
    assert (line.colour, line.dashes) == ((255, 255, 255), (1.5, 1.5))
    assert casing.width == pytest.approx(line.width + 0.24)
    (path,) = draw_roads(RoadNetwork((network.roads[-1],)), FRAME)
    assert path.dashes == pytest.approx((1.1, 0.6))


def test_pads_and_walls_are_drawn_in_the_styles_of_what_they_carry():
    network = make_network()
    shapes = draw_roads(RoadNetwork(pads=network.pads, standing=network.standing), FRAME)
    building, hedge = (LAYERS[name].classes[at].style for name, at in (("pad", 0), ("wall", 1)))
    colour = rgb_from_hex(building["fill"])
    (house,) = (each for each in shapes if isinstance(each, Polygons) and each.colour == colour)
    assert house.paths[0][0] == pytest.approx(FRAME.to_sheet([600.0, 600.0]))
    (line,) = lines_of(shapes, hedge["colour"])
    assert line.paths[0] == pytest.approx(FRAME.to_sheet(network.standing[1].line))


def test_the_legend_has_only_what_is_there():
    def titles(network):
        return [title for title, symbol in road_legend(network, 11.0, 4.4) if symbol]

    network = make_network()
    known = ["Road", "Railway", "Path", "Bridge", "Tunnel", "Level ground", "Building", "Wall", "Hedge"]
    assert titles(network) == known
    assert titles(RoadNetwork((straight_road(),), standing=network.standing[1:])) == ["Road", "Hedge"]
    assert titles(RoadNetwork()) == []
    assert draw_roads(RoadNetwork(), FRAME) == []
