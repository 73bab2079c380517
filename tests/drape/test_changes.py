"""Layers that change while the ground does, and while tiles of both are on their way."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from sketchterrain.benchmarks.draped_data import random_lines, write_layer
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.drape.drapes import Drapes
from sketchterrain.features.edits import with_places
from sketchterrain.generation.building import rebuild
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.offscreen import read_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun
from tests import terrains
from tests.render.conftest import SharedTextures

SIZE = (160, 100)
BARE = ("clouds", "haze", "grass", "rocks", "detail", "shadows", "trees")
COARSE = {"tolerance": 24.0, "finest_quad": 8.0, "draw_distance": 3.0}
QUALITY = replace(
    Quality.from_level(0.0, without=BARE), quads=64, map_texels=128, material_texels=128, **COARSE
)
SUN = Sun(200.0, 60.0)
CAMERA = Camera((375.0, 150.0, 175.0), (500.0, 500.0, 25.0), near=1.0, far=30_000.0)

pytestmark = [pytest.mark.gl, pytest.mark.slow]


@pytest.fixture
def drapes(tmp_path):
    lines = random_lines(60, 1024.0, step=30.0)
    lines[0] = shapely.LineString([(375.0, 250.0), (625.0, 600.0)])
    layer = DrapedLayer(str(write_layer(tmp_path / "lines.fgb", lines)), style={"width": 5.0, "unit": "m"})
    sketch = terrains.plain().sketch
    return Drapes.open([layer], sketch.frame, sketch.size, sketch.extent)


@pytest.fixture(scope="module")
def studio(gl):
    """Return a function that opens a renderer; its ``still`` returns the finished picture."""
    loaded, texture = {}, gl.texture(SIZE, 4)
    framebuffer = gl.framebuffer([texture])

    def open_renderer(terrain, drapes):
        gl.__enter__()
        options = {"sun": SUN, "quality": QUALITY, "drapes": drapes}
        renderer = Renderer(gl, terrain, resources=SharedTextures(loaded), **options)

        def still():
            renderer.prepare(CAMERA, SIZE)
            renderer.draw(CAMERA, framebuffer)
            return read_picture(texture)

        return SimpleNamespace(renderer=renderer, still=still, framebuffer=framebuffer)

    return open_renderer


def test_a_terrain_that_changes_below_layers_shows_them_as_a_new_one_does(drapes, studio):
    terrain = terrains.plain()
    sketch = terrain.sketch.replace(density={"mountain": 20.0, "hill": 20.0})
    changed, areas = rebuild(terrain, sketch)
    room = studio(terrain, drapes)
    before = room.still()
    room.renderer.set_terrain(changed, areas)
    after = room.still()
    assert np.abs(after.astype(int) - before).max() > 60
    assert np.array_equal(after, studio(changed, drapes).still())


def test_a_feature_that_moves_while_tiles_are_loaded_ends_where_it_is(drapes, studio):
    terrain = terrains.plain()
    room = studio(terrain, drapes)
    shown, held = drapes, (0, 0)
    for step in range(12):
        table = shown.table(0)
        moved = table.feature(0).rings[0] + np.array([4.0, -2.5])
        edited = shown.layers[0].replace(edits=with_places(table, 0, moved).edits)
        shown = shown.updated([edited])
        room.renderer.set_drapes(shown, held if step < 8 else None)
        room.renderer.frame(CAMERA, room.framebuffer, elapsed=0.05, budget=0.004)
    after = room.still()
    assert np.array_equal(after, studio(terrain, shown).still())
    undone = shown.updated(drapes.layers)
    assert np.array_equal(studio(terrain, undone).still(), studio(terrain, drapes).still())
