"""GLB read again by trimesh, pygltflib and by its bytes: in its place, the right way up, within its error."""

from __future__ import annotations

import io
import json
import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.export.gltf import Glb
from sketchterrain.export.gltf_plants import INSTANCING, herb_model
from sketchterrain.export.target import ExportOptions
from sketchterrain.export.targets.gltf import check_glb

pygltflib = pytest.importorskip("pygltflib")

SIZE = 65
SPACING = 16.0


@pytest.fixture(scope="module")
def whole(exported):
    return exported("gltf", size=SIZE)


@pytest.fixture(scope="module")
def adaptive(exported):
    return exported("gltf", size=SIZE, error=2.0, plants=False)


@pytest.fixture(scope="module")
def plants(terrain):
    return terrain.foliage(0.0, 0.0, 1024.0, 1024.0)


def scene_of(outcome, ending="high_corner.glb"):
    return trimesh.load(outcome.of(ending)[0], process=False)


def ground_of(outcome):
    """The ground's vertices as x east, y north, z up, and its triangles, by trimesh."""
    scene = scene_of(outcome)
    turn, geometry = scene.graph.get("ground")
    mesh = scene.geometry[geometry]
    x, y, z = trimesh.transform_points(mesh.vertices, turn).T
    return np.stack([x, -z, y], axis=-1), mesh


def accessor(gltf, index):
    """An accessor's numbers, read by what pygltflib says of them."""
    told = gltf.accessors[index]
    view = gltf.bufferViews[told.bufferView]
    kind = {5126: "<f4", 5125: "<u4", 5123: "<u2"}[told.componentType]
    wide = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[told.type]
    start = view.byteOffset + (told.byteOffset or 0)
    blob = gltf.binary_blob()[start : start + told.count * wide * np.dtype(kind).itemsize]
    return np.frombuffer(blob, kind).reshape(told.count, wide)


def test_the_ground_has_the_terrains_heights_and_faces_up(whole, terrain):
    places, mesh = ground_of(whole)
    x, y = whole.places()
    assert len(places) == x.size
    assert len(mesh.faces) == 2 * (SIZE - 1) ** 2
    order = np.lexsort((places[:, 0], -places[:, 1]))
    assert np.abs(places[order, 0] - x.ravel()).max() < 1e-4
    assert np.abs(places[order, 1] - y.ravel()).max() < 1e-4
    heights = terrain.heights(x.ravel(), y.ravel(), cell_size=SPACING)
    assert np.abs(places[order, 2] - heights).max() < 1e-3

    places, mesh = ground_of(whole)
    top = places[places[:, 2].argmax()]
    assert top[0] > 700.0
    assert top[1] > 700.0
    assert (mesh.face_normals[:, 1] > 0.0).all()
    assert (mesh.vertex_normals[:, 1] > 0.0).all()


def test_an_adaptive_ground_stays_within_its_error(exported, terrain):
    for error in [0.25, 2.0, 20.0]:
        outcome = exported("gltf", size=SIZE, error=error, plants=False)
        places, mesh = ground_of(outcome)
        x, y = (each.ravel() for each in outcome.places())
        heights = terrain.heights(x, y, cell_size=SPACING)
        surface = np.full(x.size, np.nan)
        for a, b, c in places[mesh.faces]:
            area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            wb = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
            wc = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
            inside = (wb > -1e-9) & (wc > -1e-9) & (wb + wc < 1.0 + 1e-9)
            surface[inside] = (a[2] + wb * (b[2] - a[2]) + wc * (c[2] - a[2]))[inside]
        off = np.abs(surface - heights).max()
        told = outcome.sidecar["mesh"]
        assert told["triangles"] == len(mesh.faces) < 2 * (SIZE - 1) ** 2, error
        assert told["error_asked"] == error, error
        assert told["error_measured"] <= error, error
        assert off == pytest.approx(told["error_measured"], abs=1e-3), error


def test_chunks_and_accessors_follow_the_format(whole):
    for path in whole.of(".glb"):
        content = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", content)
        assert (magic, version, length) == (b"glTF", 2, len(content))
        text, kind = struct.unpack_from("<I4s", content, 12)
        binary, other = struct.unpack_from("<I4s", content, 20 + text)
        assert (kind, other, text % 4, binary % 4) == (b"JSON", b"BIN\0", 0, 0)
        told = json.loads(content[20 : 20 + text])
        assert told["buffers"] == [{"byteLength": binary}]
        assert all(view["byteOffset"] % 4 == 0 for view in told["bufferViews"])
        ends = [view["byteOffset"] + view["byteLength"] for view in told["bufferViews"]]
        starts = [view["byteOffset"] for view in told["bufferViews"][1:]] + [binary]
        assert all(end <= start < end + 4 for end, start in zip(ends, starts, strict=True))

    gltf = pygltflib.GLTF2().load(whole.of("high_corner.glb")[0])
    for mesh in gltf.meshes:
        (primitive,) = mesh.primitives
        if primitive.indices is not None:
            assert gltf.accessors[primitive.indices].componentType == pygltflib.UNSIGNED_INT
        position = gltf.accessors[primitive.attributes.POSITION]
        values = accessor(gltf, primitive.attributes.POSITION)
        assert position.min == values.min(axis=0).tolist()
        assert position.max == values.max(axis=0).tolist()
        assert np.abs(np.linalg.norm(accessor(gltf, primitive.attributes.NORMAL), axis=1) - 1).max() < 1e-5


def test_the_baked_colours_lie_where_the_materials_are(whole, terrain):
    gltf = pygltflib.GLTF2().load(whole.of("high_corner.glb")[0])
    view = gltf.bufferViews[gltf.images[0].bufferView]
    content = gltf.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    image = np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(int)
    assert image.shape == (SIZE, SIZE, 3)
    primitive = next(mesh for mesh in gltf.meshes if mesh.name == "ground").primitives[0]
    texel = accessor(gltf, primitive.attributes.TEXCOORD_0) * SIZE - 0.5
    column, row = np.rint(texel).astype(int).T
    assert np.abs(texel - np.stack([column, row], axis=-1)).max() < 1e-3
    places, _ = ground_of(whole)
    top = places[:, 2].argmax()
    meadow = np.hypot(places[:, 0] - 620.0, places[:, 1] - 560.0).argmin()
    red, green, _ = image[row[top], column[top]]
    assert abs(red - green) < 25  # rock or snow
    red, green, blue = image[row[meadow], column[meadow]]
    assert green > red > blue  # grass


def test_instances_stand_where_the_plants_do(whole, plants):
    gltf = pygltflib.GLTF2().load(whole.of("high_corner.glb")[0])
    assert gltf.extensionsUsed == [INSTANCING]
    assert not gltf.extensionsRequired
    rows = []
    for node in gltf.nodes:
        if not node.extensions:
            continue
        told = node.extensions[INSTANCING]["attributes"]
        place = accessor(gltf, told["TRANSLATION"]) + np.array(node.translation)
        spin, scale = accessor(gltf, told["ROTATION"]), accessor(gltf, told["SCALE"])
        assert (spin[:, [0, 2]] == 0.0).all()
        assert (place[0] == np.array(node.translation)).all()  # where the extension is not known
        turn = 2.0 * np.arctan2(spin[:, 1], spin[:, 3])
        assert (scale == scale[:, :1]).all()
        rows.append(np.column_stack([place[:, 0], -place[:, 2], place[:, 1], scale[:, 0], turn]))
    found = np.concatenate(rows)
    assert len(found) == len(plants) == whole.sidecar["plants"]["count"] > 500
    found, wanted = found[np.lexsort(found[:, :2].round(3).T)], plants[np.lexsort((plants["x"], plants["y"]))]
    found = found[np.lexsort((found[:, 0], found[:, 1]))]
    for column, name, bound in ((0, "x", 1e-3), (1, "y", 1e-3), (3, "scale", 1e-6)):
        assert np.abs(found[:, column] - wanted[name]).max() < bound
    assert np.abs(np.exp(1j * found[:, 4]) - np.exp(1j * wanted["rotation"])).max() < 1e-5


def test_models_of_plants_stand_on_their_feet_at_their_size(whole):
    gltf = pygltflib.GLTF2().load(whole.of("high_corner.glb")[0])
    names = {mesh.name: mesh for mesh in gltf.meshes if mesh.name.split()[0] in {"oak", "spruce", "birch"}}
    assert names
    for mesh in names.values():
        place = accessor(gltf, mesh.primitives[0].attributes.POSITION)
        assert 8.0 < place[:, 1].max() < 20.0
        assert -1.0 < place[:, 1].min() <= 0.05
        assert np.abs(place[:, [0, 2]].mean(axis=0)).max() < 1.5

    for species in ["grass", "flower", "fern"]:
        model = herb_model(species)
        assert 0.2 < model.place[:, 1].max() < 0.8, species
        assert model.place[:, 1].min() == 0.0, species
        assert (model.normal[:, 1] > 0.0).all(), species


def test_points_are_the_same_plants_for_programs_without_the_extension(whole, plants):
    gltf = pygltflib.GLTF2().load(whole.of("plant_points.glb")[0])
    assert not gltf.extensionsUsed
    count = 0
    for node in gltf.nodes:
        (primitive,) = gltf.meshes[node.mesh].primitives
        assert primitive.mode == pygltflib.POINTS
        place = accessor(gltf, primitive.attributes.POSITION).astype(float) + np.array(node.translation)
        of_species = plants[plants["species"] == ["spruce", "pine", "oak", "birch", "shrub"].index(node.name)]
        assert len(place) == len(of_species) == len(accessor(gltf, primitive.attributes._SCALE))
        assert np.sort(place[:, 0]) == pytest.approx(np.sort(of_species["x"]), abs=1e-3)
        assert np.sort(-place[:, 2]) == pytest.approx(np.sort(of_species["y"]), abs=1e-3)
        count += len(place)
    assert count == len(plants)


def test_waters_lie_where_they_were_placed(whole, terrain):
    scene = scene_of(whole)
    (lake,), (river,) = terrain.features.lakes, terrain.features.rivers
    for name, line in ((f"river {river.id}", river.centreline), (f"lake {lake.id}", None)):
        turn, geometry = scene.graph.get(name)
        mesh = scene.geometry[geometry]
        x, up, south = trimesh.transform_points(mesh.vertices, turn).T
        assert (mesh.face_normals[:, 1] > 0.99 if line is None else mesh.face_normals[:, 1] > 0.0).all()
        if line is None:
            assert np.abs(up - lake.level).max() < 1e-3
            assert x.max() < 300.0
            assert -south.max() < 260.0
        else:
            assert up.max() == pytest.approx(line[:, 2].max(), abs=0.5)
            north = line[line[:, 1].argmax()]
            at = (-south).argmax()
            assert abs(x[at] - north[0]) < 40.0
            assert abs(-south[at] - north[1]) < 40.0


def test_without_plants_there_is_no_extension_and_no_file_of_points(adaptive):
    assert not adaptive.of("plant_points.glb")
    gltf = pygltflib.GLTF2().load(adaptive.of("high_corner.glb")[0])
    assert not gltf.extensionsUsed


def test_oversized_and_unusable_scenes_are_refused(exported, monkeypatch, tmp_path):
    for error in (0.0, -1.0, float("nan"), 1e-9):
        with pytest.raises(InputError, match="expected an error of a mesh"):
            check_glb(ExportOptions(error=error))
    with pytest.raises(InputError, match="4 GiB"):
        check_glb(ExportOptions(size=16385))
    check_glb(ExportOptions(size=16385, error=1.0))

    monkeypatch.setattr("sketchterrain.export.gltf_plants.MOST_PLANTS", 100)
    with pytest.raises(InputError, match="plants: a GLB takes 100: expected no grass"):
        exported("gltf", size=17)

    monkeypatch.setattr("sketchterrain.export.gltf.LARGEST", 100)
    glb = Glb()
    glb.attribute(np.zeros((20, 3), np.float32))
    with pytest.raises(InputError, match="holds 4 GiB"):
        glb.write(tmp_path / "large.glb")
    assert list(tmp_path.iterdir()) == []
