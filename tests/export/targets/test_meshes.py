"""OBJ and STL read again by trimesh: in their place, the right way up, within their error, closed."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

SIZE = 33


def wanted(outcome, terrain):
    x, y = (each.ravel() for each in outcome.places())
    return x, y, terrain.heights(x, y, cell_size=1024.0 / (SIZE - 1))


def by_place(places):
    return places[np.lexsort(places[:, :2].round(2).T)]


@pytest.fixture(scope="module")
def obj(exported):
    return exported("obj", size=SIZE)


@pytest.fixture(scope="module")
def stl(exported):
    return exported("stl", size=SIZE)


def ground_of(outcome):
    scene = trimesh.load(outcome.of(".obj")[0], process=False)
    return scene.geometry["ground"]


def test_an_obj_has_the_terrains_heights_and_an_upright_texture(obj, terrain):
    mesh = ground_of(obj)
    x, up, south = np.unique(mesh.vertices.round(9), axis=0).T
    found = by_place(np.stack([x, -south, up], axis=-1))
    assert np.abs(found - by_place(np.stack(wanted(obj, terrain), axis=-1))).max() < 1e-3
    top = mesh.vertices[mesh.vertices[:, 1].argmax()]
    assert top[0] > 700.0
    assert -top[2] > 700.0
    assert (mesh.face_normals[:, 1] > 0.0).all()
    assert obj.sidecar["mesh"]["error_measured"] <= 0.5e-4

    mesh = ground_of(obj)
    u, v = mesh.visual.uv.T
    column, row = np.rint(u * SIZE - 0.5), np.rint((1.0 - v) * SIZE - 0.5)
    assert np.abs(mesh.vertices[:, 0] - 32.0 * column).max() < 1e-3
    assert np.abs(-mesh.vertices[:, 2] - (1024.0 - 32.0 * row)).max() < 1e-3


def test_an_obj_counts_from_one_and_names_what_is_there(obj, terrain):
    lines = obj.of(".obj")[0].read_text(encoding="ascii").splitlines()
    counts = {word: sum(line.startswith(f"{word} ") for line in lines) for word in ("v", "vt", "vn", "f")}
    corners = [corner.split("/") for line in lines if line.startswith("f ") for corner in line[2:].split(" ")]
    for place, word in enumerate(("v", "vt", "vn")):
        numbers = {int(corner[place]) for corner in corners if corner[place]}
        assert (min(numbers), max(numbers)) == (1, counts[word])
    (lake,), (river,) = terrain.features.lakes, terrain.features.rivers
    objects = [line[2:] for line in lines if line.startswith("o ")]
    assert objects == ["ground", f"lake_{lake.id}", f"river_{river.id}"]
    library = obj.of(".mtl")[0].read_text(encoding="ascii")
    for line in lines:
        if line.startswith("usemtl "):
            assert f"newmtl {line[7:]}" in library
    picture = next(line[7:] for line in library.splitlines() if line.startswith("map_Kd "))
    with Image.open(obj.folder / picture) as image:
        assert image.size == (SIZE, SIZE)


def test_an_stl_is_a_closed_solid_in_the_binary_format(stl, terrain):
    mesh = trimesh.load(stl.of(".stl")[0])
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    x, y, z = wanted(stl, terrain)
    floor = stl.sidecar["mesh"]["floor"]
    assert mesh.bounds[0] == pytest.approx([0.0, 0.0, floor], abs=1e-3)
    assert mesh.bounds[1] == pytest.approx([1024.0, 1024.0, z.max()], abs=1e-3)
    assert floor == pytest.approx(z.min() - 0.02 * 1024.0, abs=1e-2)
    ground = np.unique(mesh.vertices[mesh.vertices[:, 2] > floor + 1.0], axis=0)
    assert np.abs(by_place(ground) - by_place(np.stack([x, y, z], axis=-1))).max() < 1e-3

    content = stl.of(".stl")[0].read_bytes()
    (count,) = struct.unpack_from("<I", content, 80)
    assert not content.startswith(b"solid")  # that would be text
    assert len(content) == 84 + 50 * count
    assert count == stl.sidecar["mesh"]["solid_triangles"]
    facets = np.frombuffer(content[84:], np.dtype([("floats", "<f4", 12), ("rest", "<u2")]))
    normal, a, b, c = np.moveaxis(facets["floats"].reshape(-1, 4, 3).astype(float), 1, 0)
    cross = np.cross(b - a, c - a)
    assert np.abs(normal - cross / np.linalg.norm(cross, axis=1, keepdims=True)).max() < 1e-4


def test_adaptive_meshes_stay_within_their_error(exported, terrain):
    for target in ["obj", "stl"]:
        pytest.importorskip("pydelatin")
        outcome = exported(target, size=SIZE, error=1.0, plants=False)
        told = outcome.sidecar["mesh"]
        assert told["error_measured"] <= told["error_asked"] == 1.0, target
        assert told["triangles"] < 2 * (SIZE - 1) ** 2, target
        if target == "obj":
            mesh = ground_of(outcome)
            places = np.stack([mesh.vertices[:, 0], -mesh.vertices[:, 2], mesh.vertices[:, 1]], axis=-1)
        else:
            mesh = trimesh.load(outcome.of(".stl")[0])
            assert mesh.is_watertight, target
            places = mesh.vertices
        faces = mesh.faces[mesh.face_normals[:, 1 if target == "obj" else 2] > 1e-9]
        x, y, z = wanted(outcome, terrain)
        surface = np.full(x.size, np.nan)
        for a, b, c in places[faces]:
            area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            wb = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
            wc = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
            inside = (wb > -1e-9) & (wc > -1e-9) & (wb + wc < 1.0 + 1e-9)
            surface[inside] = (a[2] + wb * (b[2] - a[2]) + wc * (c[2] - a[2]))[inside]
        assert np.abs(surface - z).max() == pytest.approx(told["error_measured"], abs=1e-3), target
