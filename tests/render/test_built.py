"""Roads and what is built: meshes against their sections, pictures against what must and must not change."""

from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.geometry.camera import Camera
from sketchterrain.look.built_meshes import MOUTH, joined_parts, triangulated
from sketchterrain.look.road_meshes import built_objects, road_surfaces
from sketchterrain.render.built import BuiltScenery
from sketchterrain.render.offscreen import read_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Sun
from sketchterrain.roads.road_types import BRIDGE, TUNNEL, Pad, RoadNetwork
from sketchterrain.schema.layers import id_of_vector
from tests.sample_roads import WORKS, curved_road, make_network, make_road

from .conftest import Waves

SUN = Sun(200.0, 40.0)
SIZE = (240, 160)


def quality_of(level, *without):
    small = {"quads": 64, "map_texels": 128, "material_texels": 64, "tile_memory": 32 << 20}
    return replace(Quality.from_level(level, without=("clouds", "haze", *without)), **small)


class Flat(Waves):
    """Level ground with a ridge of 60 m along y = 500."""

    def __init__(self, network, level=0.0):
        super().__init__(rivers=False, plants=False)
        self.features.network = network
        self.level = level

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        return (self.level + 60.0 * np.exp(-(((y - 500.0) / 30.0) ** 2))).astype(np.float32)


def seen(camera, x, y, size=SIZE, z=0.0):
    """Return the pixel, as reals, of a place (m)."""
    at = camera.to_clip(size[0] / size[1]) @ [*(np.array([x, y, z]) - camera.eye), 1.0]
    return (0.5 + 0.5 * at[0] / at[3]) * size[0], (0.5 - 0.5 * at[1] / at[3]) * size[1]


def test_all_meshes_are_finite_and_face_outward():
    network = make_network()
    names = set()
    for each in (*built_objects(network), *road_surfaces(network)):
        names.add(each.name)
        for part in joined_parts(each.parts(np.full(len(each.places), 10.0))):
            a, b, c = (part.position[part.triangles[:, k]] for k in range(3))
            turned = np.cross(b - a, c - a)
            facing = np.einsum("ij,ij->i", turned, part.normal[part.triangles[:, 0]])
            assert (facing[np.linalg.norm(turned, axis=1) > 1e-9] > 0.0).all(), (each.name, part.material)
            assert np.isfinite(part.position).all()
            np.testing.assert_allclose(np.linalg.norm(part.normal, axis=1), 1.0, atol=1e-9)
    assert names >= {"road 1", "road 2 bridge", "railway 3 tunnel", "pad 5", "wall 7", "wall 8", "path 4"}


def test_a_bridge_follows_its_arc_and_its_piers_keep_off_roads():
    _, bridge, _ = curved_road()
    centre = np.array([300.0, 400.0])
    under = make_road([(180, 500, 5), (300, 400, 5)], vector=9, leg=9)
    (each,) = built_objects(RoadNetwork((bridge, under)))
    parts = each.parts(np.full(len(each.places), 4.0))
    deck = next(part for part in parts if part.material == "asphalt")
    radius = np.hypot(*(deck.position[:, :2] - centre).T)
    assert np.abs(np.abs(radius - 100.0) - bridge.half_width[0]).max() < 1e-6
    assert deck.position[:, 2].min() > 29.5
    standing = np.concatenate([part.position for part in parts if part.position[:, 2].min() < 4.0])
    piers = standing[(standing[:, 2] < 4.0) & (np.hypot(*(standing[:, :2] - [200, 400]).T) > 8.0)]
    piers = piers[np.hypot(*(piers[:, :2] - [300, 500]).T) > 8.0]
    assert len(piers) >= 8
    ahead = np.array([120.0, -100.0]) / np.hypot(120.0, 100.0)
    aside = np.abs((piers[:, :2] - [180, 500]) @ [-ahead[1], ahead[0]])
    assert aside.min() > under.half_width[0]
    # Where bridges meet in the air, parapets end before.
    (each,) = built_objects(RoadNetwork((replace(bridge, ends=(3, 2)),)))
    position = np.concatenate([part.position for part in each.parts(np.full(len(each.places), 4.0))])
    for end, highest in ((bridge.axis[0], 0.1), (bridge.axis[-1], 1.0)):
        near = np.hypot(*(position[:, :2] - end[:2]).T) < 6.0
        assert position[near, 2].max() - end[2] == pytest.approx(highest, abs=0.1)


def test_triangulation_covers_a_concave_outline_once():
    outline = np.array([[0, 0], [6, 0], [6, 4], [4, 4], [4, 1], [2, 1], [2, 4], [0, 4]], float)
    a, b, c = np.moveaxis(outline[triangulated(outline)], 1, 0)
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert (area > 0.0).all()
    assert area.sum() == pytest.approx(24.0 - 6.0)


@pytest.mark.gl
def test_a_tunnel_is_dark_inside_and_a_house_throws_a_shadow(draw):
    tunnel = make_road([(500, 430, 0), (500, 570, 0)], layer="railway", structure=TUNNEL, vector=3, part=1)
    front = make_road([(500, 300, 0), (500, 430, 0)], layer="railway", vector=3)
    options = {"size": SIZE, "sun": SUN, "quality": quality_of(0.5, "grass", "rocks")}
    camera = Camera((500.0, 400.0, 3.0), (500.0, 430.0, 2.5), near=0.5, far=30_000.0)
    network = RoadNetwork((front, tunnel))
    assert any(part.material == MOUTH for part in built_objects(network)[0].parts(np.zeros(0)))
    shown = draw(Flat(network), camera, **options)
    bare = draw(Flat(RoadNetwork((front,))), camera, **options)
    column, row = (round(each) for each in seen(camera, 500.0, 430.0, z=3.0))
    assert shown[row - 4 : row + 4, column - 4 : column + 4].mean() < 25
    assert bare[row - 4 : row + 4, column - 4 : column + 4].mean() > 60
    outline = np.array([[490.0, 240.0], [510.0, 240.0], [510.0, 252.0], [490.0, 252.0]])
    house = Pad(id_of_vector("pad", 5), outline, level=0.0, reach=8.0, building=8.0, works=WORKS)
    camera = Camera((500.0, 300.0, 90.0), (500.0, 250.0, 0.0), near=1.0, far=30_000.0)  # from the north
    shown, bare = (draw(Flat(RoadNetwork(pads=pads)), camera, **options) for pads in ((house,), ()))
    column, row = (round(each) for each in seen(camera, 500.0, 256.0))
    assert shown[row, column].sum() < 0.8 * bare[row, column].sum()


@pytest.mark.gl
def test_marks_of_a_deck_continue_those_of_the_ground(draw):
    """Dashes of 3 m begin at multiples of 9 m from the leg's start; edge lines do not end."""
    deck = make_road(
        [(440, 250, 12), (560, 250, 12)], structure=BRIDGE, crossfall=np.zeros((2, 2)), start=4.0
    )
    camera = Camera((500.0, 249.0, 42.0), (500.0, 250.0, 12.0), near=1.0, far=30_000.0)
    quality = quality_of(0.0, "shadows")
    shown = draw(Flat(RoadNetwork((deck,))), camera, size=SIZE, sun=SUN, quality=quality)[..., 1]
    across = {y: round(seen(camera, 500.0, y, z=12.0)[1] - 0.5) for y in (250.0, 251.4, 252.75)}
    columns = np.arange(20, 220)
    along = 500.0 + (columns + 0.5 - seen(camera, 500.0, 250.0, z=12.0)[0]) * (
        10.0 / (seen(camera, 510.0, 250.0, z=12.0)[0] - seen(camera, 500.0, 250.0, z=12.0)[0])
    )
    phase = (along - 440.0 + 4.0) % 9.0
    middle, plain, edge = (shown[row, columns] for row in across.values())
    assert middle[(phase > 0.5) & (phase < 2.5)].min() > plain.max() + 8
    assert middle[(phase > 3.5) & (phase < 8.5)].max() <= plain.max() + 4
    assert edge.min() > plain.max() + 8


@pytest.mark.gl
def test_a_picture_in_parts_is_bit_equal(gl, open_renderer):
    camera, size = Camera((300.0, 60.0, 90.0), (450.0, 250.0, 30.0), near=1.0, far=30_000.0), (120, 80)
    quality = replace(quality_of(0.5), without=frozenset())
    pictures = []
    for refined in (False, True):
        texture = gl.texture(size, 4)
        framebuffer = gl.framebuffer([texture])
        renderer = open_renderer(Flat(make_network()), sun=SUN, quality=quality)
        if refined:
            for _ in renderer.refined(camera, framebuffer):
                pass
        else:
            renderer.prepare(camera, size)
            renderer.draw(camera, framebuffer)
        assert renderer.scenery.built.triangles > 1000
        pictures.append(read_picture(texture))
    assert np.array_equal(*pictures)


@pytest.mark.gl
def test_an_edit_rebuilds_what_it_changes(gl, monkeypatch):
    network = make_network()
    built = BuiltScenery(gl, Flat(network), defines={})
    objects = dict(built._objects)
    assert built.changes == 1
    assert built.clearance(tuple(network.roads[2].axis[0] + np.array([0.0, 0.0, 2.0]))) == pytest.approx(2.0)
    built.set_terrain(Flat(network), ())
    assert built.changes == 1
    moved = replace(network.roads[2], axis=np.add(network.roads[2].axis, [0.0, 0.0, 5.0]))
    built.set_terrain(Flat(replace(network, roads=(moved, *network.roads[1:]))), [(0.0, 0.0, 10.0, 10.0)])
    assert built.changes == 2
    assert all(built._objects[key] is objects[key] for key in objects)
    bridge = next(key for key in objects if key[0] == network.roads[2].id and key[1] == BRIDGE)
    built.set_terrain(Flat(network, -1.0), [(150.0, 350.0, 350.0, 550.0)])  # the ground under the bridge
    assert [key for key in objects if built._objects[key] is not objects[key]] == [bridge]
    built.set_terrain(Flat(RoadNetwork()), [])
    assert not built
    assert built.clearance((0.0, 0.0, 0.0)) == np.inf
