"""Overlays and feature lines."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import moderngl
import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera
from sketchterrain.landforms.placement.feature_types import FEATURE
from sketchterrain.render.flight import CameraStates
from sketchterrain.render.ground_stream import TerrainStream
from sketchterrain.render.offscreen import capture_frames, read_picture, render_picture
from sketchterrain.render.overlays import FEATURE_COLOURS, OVERLAYS, Overlay, feature_lines
from sketchterrain.render.quality import Quality
from sketchterrain.render.targets import FrameBlock
from sketchterrain.schema.layers import LAYERS
from sketchterrain.tiles.lod import ScreenError
from tests.sample_roads import make_network

from .conftest import Waves
from .ground_model import TILE_BYTES

SIZE = (160, 90)
SMALL = Quality(quads=64, tile_memory=300 * TILE_BYTES)
SKY = (178, 204, 230)
CAMERA = Camera((500.0, -100.0, 160.0), (500.0, 900.0, 0.0), fov=50.0, near=5.0, far=30_000.0)


@pytest.fixture(scope="module")
def painted(gl):
    """Return a function that draws an overlay over plain sky and returns the picture and the legend."""
    waves = Waves()
    stream = TerrainStream(gl, waves, SMALL, metric=ScreenError(quad=3.0))
    stream.converge(CAMERA, SIZE, draw_distance=6000.0)
    overlay = Overlay(gl, waves, stream)
    texture = gl.texture(SIZE, 4)
    target = gl.framebuffer([texture])

    def paint(name):
        frame = FrameBlock(gl)
        frame["to_clip"] = CAMERA.to_clip(SIZE[0] / SIZE[1])
        frame["eye"] = (0.0, 0.0, CAMERA.eye[2])
        frame.upload()
        target.use()
        target.clear(*np.divide(SKY, 255.0), 1.0)
        overlay.draw(name, CAMERA.eye, target)
        return read_picture(texture).astype(int), overlay.legend(name)

    return paint


def columns(lines):
    return lines["from"], lines["to"], lines["colour"]


def hues(picture):
    """Normalise colours by their largest channel, to remove shading."""
    return picture / np.maximum(picture.max(axis=-1, keepdims=True), 1)


@pytest.mark.gl
def test_overlays_cover_the_terrain_only_and_are_documented(gl, waves, painted):
    page = (Path(__file__).parents[2] / "docs/overlays.md").read_text(encoding="utf-8")
    for name in OVERLAYS:
        assert f"| `{name}` |" in page
        if name == "features":
            continue
        picture, legend = painted(name)
        changed = (picture != SKY).any(axis=-1)
        assert not changed[:12].any(), name
        assert changed[-30:].mean() > (0.3 if name == "wireframe" else 0.99), name
        assert legend, name
        assert all(entry.meaning for entry in legend), name
    with pytest.raises(InputError, match="no overlay 'contours'; there are: wireframe, levels"):
        painted("contours")
    # Without tiles nothing is drawn.
    texture = gl.texture((16, 16), 4, np.full(16 * 16 * 4, 9, np.uint8).tobytes())
    overlay = Overlay(gl, waves, TerrainStream(gl, waves, SMALL))
    overlay.draw("levels", (0.0, 0.0, 9.0), gl.framebuffer([texture]))
    gl.enable_only(moderngl.NOTHING)
    assert set(texture.read()) == {9}


@pytest.mark.gl
def test_overlays_have_the_colours_of_the_legend(painted):
    picture, legend = painted("materials")
    grass, rock = (np.array(entry.colour) for entry in legend if entry.meaning in ("grass", "rock"))
    expected = 0.75 * grass + 0.25 * rock
    shade = (picture[-20:] - 0.2 * np.array(SKY)) / (0.8 * expected)
    assert np.abs(shade - shade.mean(axis=-1, keepdims=True)).max() < 0.03
    picture, _ = painted("triplanar")
    assert (picture[-20:].argmax(axis=-1) == 2).mean() > 0.95

    picture, legend = painted("levels")
    changed = picture[(picture != SKY).any(axis=-1)]
    ground = hues((changed - 0.2 * np.array(SKY)) / 0.8)
    known = hues(np.array([entry.colour for entry in legend]))
    apart = np.abs(ground[:, None] - known).max(axis=-1)
    assert (apart.min(axis=-1) < 0.08).mean() > 0.9
    assert len(np.unique(apart.argmin(axis=-1))) >= 2


@pytest.mark.gl
def test_rivers_are_visible_even_behind_terrain(gl, painted, waves):
    picture, _ = painted("features")
    again, _ = painted("features")
    assert (picture == again).all()
    assert not gl.wireframe
    line = waves.features.rivers[0].centreline
    clip = np.c_[line - CAMERA.eye, np.ones(len(line))] @ CAMERA.to_clip(SIZE[0] / SIZE[1]).T
    at = clip[:, :2] / clip[:, 3:]
    at = at[(np.abs(at) < 0.95).all(axis=1)]
    column, row = ((at * [1, -1] + 1.0) / 2.0 * SIZE).astype(int).T
    bluer = picture[..., 2] - picture[..., 0] - (SKY[2] - SKY[0])
    near = [bluer[r - 2 : r + 3, c - 2 : c + 3].max() for r, c in zip(row, column, strict=True)]
    assert len(near) > 10
    assert min(near) > 20


def test_rivers_have_centrelines_and_points_have_rings_with_posts(waves):
    start, end, colour = columns(feature_lines(waves))
    line = waves.features.rivers[0].centreline
    assert (start == line[:-1]).all()
    assert (end == line[1:]).all()
    assert (colour[:, :3] == FEATURE_COLOURS["river"]).all()
    waves.features.rivers = ()
    points = np.zeros(2, FEATURE)
    points["x"], points["y"], points["radius"] = (100.0, 700.0), (300.0, 800.0), (60.0, 90.0)
    points["type"], points["painted"] = (0, 3), (True, False)
    waves.features.points = points
    start, end, colour = columns(feature_lines(waves))
    assert len(start) == 2 * (96 + 1)
    ground = waves.heights(start[:, 0], start[:, 1])
    assert (np.abs(start[:, 2] - ground) < 0.5).all()
    rings = np.abs(np.hypot(start[:, 0] - 100.0, start[:, 1] - 300.0) - 60.0) < 1e-9
    assert rings.sum() == 96
    assert (colour[rings] == (*FEATURE_COLOURS["mountain"], 255)).all()
    assert {tuple(each) for each in colour[~rings].tolist()} == {
        (*FEATURE_COLOURS["mountain"], 255),
        (*FEATURE_COLOURS["forest"], 128),
    }
    posts = (start[:, :2] == end[:, :2]).all(axis=1)
    assert posts.sum() == 2


def test_lakes_have_shorelines(waves):
    step = np.arange(41) - 20
    inside = (10.0 - np.maximum(np.abs(step), np.abs(step[:, None]))) * 4.0 + 1.0
    shape = SimpleNamespace(west=100.0, south=-50.0, spacing=4.0, inside=inside.astype(np.float32))
    waves.features.rivers = ()
    waves.features.lakes = (SimpleNamespace(id=LAYERS["lake"].code << 48, shape=shape, level=7.0),)
    start, end, _ = columns(feature_lines(waves))
    assert np.linalg.norm(end - start, axis=1).sum() == pytest.approx(4 * 21 * 4.0)
    assert np.unique(np.round([start[:, 0], end[:, 0]], 6)).tolist()[:: 10**6] == [100.0 + 9.5 * 4.0]
    assert (start[:, 2] == 7.0).all()
    ends, count = np.unique(np.round(np.concatenate([start, end]), 6), axis=0, return_counts=True)
    assert (count == 2).all()
    assert ends[:, 0].max() == pytest.approx(100.0 + 30.5 * 4.0)


def test_axes_of_roads_outlines_of_pads_and_walls_are_lines_just_above_the_ground():
    waves, network = Waves(rivers=False), make_network()
    waves.features.network = network
    start, end, colour = columns(feature_lines(waves))
    for name in ("road", "path", "pad", "wall"):
        own = (colour[:, :3] == FEATURE_COLOURS[name]).all(axis=1)
        assert own.any(), name
        if name == "pad":
            assert set(start[own, 2].round(6).tolist()) == {each.level + 0.3 for each in network.pads}
        if name == "wall":
            assert start[own, 2] == pytest.approx(waves.heights(*start[own, :2].T) + 0.3, abs=1e-4)
    stations = np.concatenate([road.axis for road in network.roads]) + np.array([0.0, 0.0, 0.3])
    ends = {tuple(point) for point in np.concatenate([start, end]).round(6).tolist()}
    assert {tuple(point) for point in stations.round(6).tolist()} <= ends


def test_the_sea_has_a_coastline():
    start, end, colour = columns(feature_lines(Waves(rivers=False, sea_level=20.0)))
    assert len(start) > 100
    assert (colour[:, :3] == FEATURE_COLOURS["sea"]).all()
    assert (start[:, 2] == 20.0).all()
    ground = Waves().heights(*(0.5 * (start + end))[:, :2].T)
    assert np.abs(ground - 20.0).max() < 5.0  # within a sample


@pytest.mark.slow
@pytest.mark.gl
def test_captured_frames_and_pictures_draw_overlays(gl, waves, monkeypatch):
    drawn = []
    monkeypatch.setattr(Overlay, "draw", lambda self, name, eye, framebuffer: drawn.append((name, eye[2])))
    views = CameraStates(
        eye=np.array([CAMERA.eye, (500.0, -90.0, 150.0)]),
        target=np.array([CAMERA.target] * 2),
        fov=np.array([50.0] * 2),
        velocity=np.zeros((2, 3)),
    )
    quick = replace(Quality.from_level(0.0), quads=64, material_texels=64, map_texels=64)
    list(
        capture_frames(
            waves, views, fps=10, size=(32, 18), quality=quick, complete=False, overlays=("levels", "error")
        )
    )
    assert drawn == [("levels", 160.0), ("error", 160.0), ("levels", 150.0), ("error", 150.0)]
    legend = []
    render_picture(waves, size=(32, 18), camera=CAMERA, quality=quick, overlays=["triplanar"], legend=legend)
    assert drawn[4:] == [("triplanar", 160.0)]
    assert [entry.meaning for entry in legend] == ["across x", "across y", "across z"]
    for call in (
        lambda: render_picture(waves, overlays=["contours"]),
        lambda: next(capture_frames(waves, views, fps=10, overlays=["contours"])),
    ):
        with pytest.raises(InputError, match="no overlay 'contours'"):
            call()
