"""Layers that change while the ground does, and while tiles of both are on their way."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from sketchterrain.benchmarks.draped_data import random_lines, write_layer
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.sketch import Sketch
from sketchterrain.drape.drapes import Drapes
from sketchterrain.drape.feature_edits import move_feature
from sketchterrain.render.camera import Camera
from sketchterrain.render.offscreen import canvas, read_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun
from sketchterrain.terrain.building import build, rebuild

SIZE = (160, 100)
BARE = ("clouds", "haze", "grass", "rocks", "detail", "shadows", "trees")
QUALITY = replace(Quality.from_level(0.0, without=BARE), quads=64)
SUN = Sun(200.0, 60.0)
CAMERA = Camera((1500.0, 600.0, 700.0), (2000.0, 2000.0, 100.0), near=1.0, far=30_000.0)
SKETCH = Sketch(density={"mountain": 0.3}, seed=3)


@pytest.fixture
def drapes(tmp_path):
    lines = random_lines(60, 4096.0, step=120.0)
    lines[0] = shapely.LineString([(1500.0, 1000.0), (2500.0, 2400.0)])
    layer = DrapedLayer(str(write_layer(tmp_path / "lines.fgb", lines)), style={"width": 20.0, "unit": "m"})
    return Drapes.open([layer], SKETCH.frame, SKETCH.size, SKETCH.extent)


def still(terrain, drapes):
    with canvas(SIZE) as (context, texture, framebuffer):
        renderer = Renderer(context, terrain, sun=SUN, quality=QUALITY, drapes=drapes)
        renderer.prepare(CAMERA, SIZE)
        renderer.draw(CAMERA, framebuffer)
        return read_picture(texture)


@pytest.mark.gl
@pytest.mark.slow
def test_a_terrain_that_changes_below_layers_shows_them_as_a_new_one_does(drapes):
    terrain = build(SKETCH)
    changed, areas = rebuild(terrain, SKETCH.replace(density={"mountain": 1.5, "hill": 2.0}))
    with canvas(SIZE) as (context, texture, framebuffer):
        renderer = Renderer(context, terrain, sun=SUN, quality=QUALITY, drapes=drapes)
        renderer.prepare(CAMERA, SIZE)
        renderer.draw(CAMERA, framebuffer)
        before = read_picture(texture)
        renderer.set_terrain(changed, areas)
        renderer.prepare(CAMERA, SIZE)
        renderer.draw(CAMERA, framebuffer)
        after = read_picture(texture)
    assert np.abs(after.astype(int) - before).max() > 60
    assert np.array_equal(after, still(changed, drapes))


@pytest.mark.gl
@pytest.mark.slow
def test_a_feature_that_moves_while_tiles_are_loaded_ends_where_it_is(drapes):
    terrain, layer = build(SKETCH), drapes.layers[0]
    with canvas(SIZE) as (context, texture, framebuffer):
        renderer = Renderer(context, terrain, sun=SUN, quality=QUALITY, drapes=drapes)
        shown, held = drapes, (0, 0)
        for step in range(12):
            layer = move_feature(layer, shown.feature(*held), 15.0, -10.0)
            shown = shown.updated([layer])
            renderer.set_drapes(shown, held if step < 8 else None)
            renderer.frame(CAMERA, framebuffer, elapsed=0.05, budget=0.004)
        renderer.prepare(CAMERA, SIZE)
        renderer.draw(CAMERA, framebuffer)
        after = read_picture(texture)
    assert np.array_equal(after, still(terrain, shown))
    undone = shown.updated(drapes.layers)
    assert np.array_equal(still(terrain, undone), still(terrain, drapes))
