"""Plants in whole pictures: parts left out, wind, feet on the drawn ground."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from sketchterrain.look.trees import DETAILS
from sketchterrain.render import Camera, Quality, Sun
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.snapshot import canvas, read_picture
from sketchterrain.render.weather import Weather

from .conftest import Waves

pytestmark = pytest.mark.gl

SIZE = (240, 136)
SUN = Sun(200.0, 35.0)
CAMERA = Camera((430.0, 235.0, 110.0), (430.0, 304.0, 40.0))
STILL = ("grass", "water", "clouds", "rocks")


class Woods(Waves):
    """A row of plants, near each other."""

    def heights(self, x, y, *, cell_size=0.0):
        ripples = 3.6 * np.sin(np.asarray(x, float) / 4.1) * np.cos(np.asarray(y, float) / 5.3)
        return super().heights(x, y) + ripples.astype(np.float32)

    def foliage(self, west, south, east, north):
        plants = super().foliage(-1e9, -1e9, 1e9, 1e9)
        plants["x"] = np.linspace(380.0, 480.0, len(plants))
        plants["z"] = self.heights(plants["x"], plants["y"])
        inside = (plants["x"] >= west) & (plants["x"] < east) & (plants["y"] >= south) & (plants["y"] < north)
        return plants[inside]


@cache
def picture(*, without=STILL, clock=0.0, wind=0.0, camera=CAMERA, **changes):
    quality = Quality(
        without=frozenset(without),
        materials=1,
        planes=1,
        octaves=1,
        hexes=1,
        material_texels=128,
        map_texels=128,
        light_maps=2,
        surface_texels=256,
        samples=1,
        shade_texels=512,
        tile_memory=64 << 20,
        **changes,
    )
    with canvas(SIZE) as (context, texture, framebuffer):
        weather = Weather(wind=wind, clouds=0.0)
        renderer = Renderer(context, Woods(rivers=False), sun=SUN, weather=weather, quality=quality)
        renderer.prepare(camera, SIZE)
        renderer.draw(camera, framebuffer, clock=clock)
        return read_picture(texture).astype(int)


@pytest.mark.slow
def test_without_trees_nothing_is_planted_and_nothing_throws_a_shadow():
    bare, planted = picture(without=(*STILL, "trees")), picture()
    changed = np.abs(planted - bare).max(axis=2) > 12
    assert 0.02 < changed.mean() < 0.5
    unshaded = picture(without=(*STILL, "shadows"))
    plants = np.abs(unshaded - picture(without=(*STILL, "shadows", "trees"))).max(axis=2) > 12
    assert 0.01 < plants.mean() < 0.9 * changed.mean()  # the shadows are gone, the plants are not


@pytest.mark.slow
def test_the_clock_moves_plants_only_in_the_wind():
    assert (picture(clock=0.0) == picture(clock=3.3)).all()
    windy = [picture(clock=clock, wind=12.0) for clock in (0.0, 3.3)]
    moved = np.abs(windy[1] - windy[0]).max(axis=2) > 4
    assert moved.sum() > 60
    bare = picture(without=(*STILL, "trees"))
    plants = np.any([np.abs(each - bare).max(axis=2) > 2 for each in windy], axis=0)
    assert not (moved & ~plants).any()


@pytest.mark.slow
@pytest.mark.parametrize("maps", [0, 2])
def test_plants_lit_at_their_vertices_have_the_colour_of_those_lit_at_each_pixel(monkeypatch, maps):
    bare = picture(without=(*STILL, "trees"), shade_maps=maps)
    coarse = {"leaves": 0.03, "shade_maps": maps}  # all of them coarse
    at_vertices = picture(**coarse)
    monkeypatch.setattr("sketchterrain.render.forest.LIT", DETAILS)
    at_pixels = picture.__wrapped__(**coarse)
    changed = [np.abs(each - bare).max(axis=2) > 20 for each in (at_vertices, at_pixels)]
    both = changed[0] & changed[1]
    assert both.sum() > 200
    assert both.sum() > 0.8 * max(each.sum() for each in changed)
    light, exact = (((each[both] / 255.0) ** 2.2).mean(axis=0) for each in (at_vertices, at_pixels))
    assert light == pytest.approx(exact, rel=0.25)


@pytest.mark.slow
def test_feet_stand_on_the_ground_as_it_is_drawn():
    """With coarse tiles the drawn ground is off the true one; feet follow it."""
    quality = Quality(
        without=frozenset(STILL), material_texels=128, map_texels=128, shade_maps=0, tolerance=12.0, samples=1
    )
    camera = Camera((430.0, 296.0, 130.0), (430.0, 300.0, 40.0))
    terrain = Woods(rivers=False)
    size = (400, 300)
    with canvas(size) as (context, _, framebuffer):
        renderer = Renderer(context, terrain, sun=SUN, weather=Weather(wind=0.0), quality=quality)
        renderer.prepare(camera, size)
        renderer.draw(camera, framebuffer)
        batches = renderer.scenery.forest._batches
        feet = []
        for batch in batches:
            rows = np.frombuffer(batch._instances.read(), np.float32).reshape(-1, 8)[: batch.count]
            ground = np.frombuffer(batch._ground.read(), np.float32)
            ground = ground[: ground.size // (batch._found // 4) * (batch._found // 4)]
            ground = ground.reshape(-1, batch._found // 4)[: batch.count]
            feet.append(
                np.c_[rows[:, :2] + renderer.scenery.forest._origin, ground[:, 0] + camera.eye[2] + 0.15]
            )
        feet = np.concatenate(feet)
        # The same ground without plants: its depth at the feet.
        bare = Quality(**{**vars(quality), "without": frozenset((*STILL, "trees"))})
        ground = Renderer(context, terrain, sun=SUN, weather=Weather(wind=0.0), quality=bare)
        ground.prepare(camera, size)
        ground.draw(camera, framebuffer)
        depth = np.frombuffer(ground.scenery._targets[size].depth.read(), np.float32).reshape(size[::-1])
        matrix = ground.scenery._frame_block["to_clip"].T.astype(float)
    clip = (matrix @ np.c_[feet - camera.eye, np.ones(len(feet))].T).T
    inside = (np.abs(clip[:, :2]) < 0.98 * clip[:, 3:]).all(axis=1)
    assert inside.sum() > 12
    clip, feet = clip[inside], feet[inside]
    seen = clip[:, :3] / clip[:, 3:]
    at = np.floor((seen[:, :2] * 0.5 + 0.5) * size).astype(int)
    drawn = (
        np.c_[seen[:, :2], depth[at[:, 1], at[:, 0]] * 2.0 - 1.0, np.ones(len(at))] @ np.linalg.inv(matrix).T
    )
    drawn = drawn[:, 2] / drawn[:, 3] + camera.eye[2]
    assert np.abs(feet[:, 2] - drawn).max() < 0.3
    true = terrain.heights(feet[:, 0], feet[:, 1])
    assert np.abs(true - drawn).max() > 0.4  # else this would say nothing
