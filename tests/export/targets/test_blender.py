"""Blender's displacement, read by OpenEXR and placed as the sidecar says."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

OpenEXR = pytest.importorskip("OpenEXR")
pytest.importorskip("pygltflib")

SIZE = 33


@pytest.fixture(scope="module")
def outcome(exported):
    return exported("blender", size=SIZE, plants=False)


@pytest.fixture(scope="module")
def image(outcome):
    with OpenEXR.File(str(outcome.of("_height.exr")[0]), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


def displaced(told, image):
    """A grid as Blender makes it of the settings: U eastward, V northward, a picture's first row on top."""
    grid = told["displace_modifier"]["grid"]
    columns, rows = grid["x_subdivisions"] + 1, grid["y_subdivisions"] + 1
    v, u = (each.ravel() for each in np.mgrid[0 : 1 : rows * 1j, 0 : 1 : columns * 1j])
    x = (u - 0.5) * grid["size"] * grid["scale"]["x"] + grid["location"]["x"]
    y = (v - 0.5) * grid["size"] * grid["scale"]["y"] + grid["location"]["y"]
    high, wide = image.shape
    column = np.minimum((u * wide).astype(int), wide - 1)  # no interpolation, edges extended
    row = high - 1 - np.minimum((v * high).astype(int), high - 1)
    modifier = told["displace_modifier"]
    return x, y, modifier["strength"] * (image[row, column] - modifier["midlevel"])


def test_the_displaced_grid_is_the_terrain(outcome, image, terrain):
    assert all((channel == image["R"]).all() for channel in image.values())
    assert {channel.dtype.name for channel in image.values()} == {"float32"}
    x, y, z = displaced(outcome.sidecar["import"], image["R"])
    assert np.abs(z - terrain.heights(x, y, cell_size=1024.0 / (SIZE - 1))).max() < 1e-3
    assert min(x[z.argmax()], y[z.argmax()]) > 700.0


def test_a_texels_middle_is_its_place_on_the_plane_of_the_displacement_node(outcome, image, terrain):
    node = outcome.sidecar["import"]["displacement_node"]
    plane, n = node["plane"], SIZE
    along = (np.arange(n) + 0.5) / n - 0.5
    x = along * plane["scale"]["x"] + plane["location"]["x"]
    y = -along * plane["scale"]["y"] + plane["location"]["y"]
    x, y = (each.ravel() for each in np.meshgrid(x, y))
    z = node["scale"] * (image["R"].ravel() - node["midlevel"])
    assert np.abs(z - terrain.heights(x, y, cell_size=1024.0 / (n - 1))).max() < 1e-3


def test_the_glb_comes_to_lie_on_the_displaced_grid(outcome, image):
    scene = trimesh.load(outcome.of("high_corner.glb")[0], process=False)
    turn, geometry = scene.graph.get("ground")
    x, y, z = trimesh.transform_points(scene.geometry[geometry].vertices, turn).T
    glb = np.stack([x, -z, y], axis=-1)  # as Blender's importer turns it
    grid = np.stack(displaced(outcome.sidecar["import"], image["R"]), axis=-1)
    glb, grid = (each[np.lexsort(each[:, :2].round(2).T)] for each in (glb, grid))
    assert np.abs(glb - grid).max() < 1e-3


def test_plants_stand_apart_as_instances_and_as_points(exported):
    told = exported("blender", size=SIZE)
    names = [path.name for path in told.of(".glb")]
    assert sorted(names) == ["high_corner.glb", "high_corner_plant_points.glb", "high_corner_plants.glb"]
    scene = trimesh.load(told.of("corner.glb")[0], process=False)
    assert {name.split()[0] for name in scene.geometry} == {"ground", "river", "lake"}
    assert told.sidecar["plants"]["count"] > 500
