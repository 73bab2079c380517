"""GLB, OBJ, STL and Blender's displacement by independent readers: position, orientation, error."""

import io
import json
import struct

import numpy as np
import OpenEXR
import pygltflib
import pytest
import trimesh
from PIL import Image

from sketchterrain.export.gltf import GlbWriter
from sketchterrain.export.gltf_plants import INSTANCING, herb_model
from sketchterrain.export.target import ExportOptions
from sketchterrain.export.targets.gltf import check_glb
from tests.refusals import refused

SIZE = 65
SPACING = 16.0


@pytest.fixture(scope="module")
def whole(exported):
    return exported("gltf", size=SIZE)


@pytest.fixture(scope="module")
def obj(exported):
    return exported("obj", size=SIZE)


@pytest.fixture(scope="module")
def plants(terrain):
    return terrain.foliage(0.0, 0.0, 1024.0, 1024.0)


def expected_vertices(outcome, terrain):
    """The vertices of the terrain as x east, y north, z up."""
    x, y = (each.ravel() for each in outcome.places())
    return np.stack([x, y, terrain.heights(x, y, cell_size=SPACING)], axis=-1)


def by_place(places):
    return places[np.lexsort(places[:, :2].round(2).T)]


def ground_of(outcome):
    """The ground's vertices as x east, y north, z up, and its triangles, by trimesh."""
    if outcome.paths(".stl"):
        mesh = trimesh.load(outcome.paths(".stl")[0])
        return mesh.vertices, mesh
    path = (outcome.paths(".obj") or outcome.paths("high_corner.glb"))[0]
    scene = trimesh.load(path, process=False)
    turn, geometry = scene.graph.get("ground")
    mesh = scene.geometry[geometry]
    x, y, z = trimesh.transform_points(mesh.vertices, turn).T
    return np.stack([x, -z, y], axis=-1), mesh


def accessor(gltf, index):
    """Return an accessor's values as pygltflib describes them."""
    content = gltf.accessors[index]
    view = gltf.bufferViews[content.bufferView]
    kind = {5126: "<f4", 5125: "<u4", 5123: "<u2"}[content.componentType]
    wide = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[content.type]
    start = view.byteOffset + (content.byteOffset or 0)
    blob = gltf.binary_blob()[start : start + content.count * wide * np.dtype(kind).itemsize]
    return np.frombuffer(blob, kind).reshape(content.count, wide)


def test_terrain_mesh_matches_heights_and_faces_up(whole, obj, terrain):
    for outcome in (whole, obj):
        places, mesh = ground_of(outcome)
        found = by_place(np.unique(places.round(9), axis=0))
        assert np.abs(found - by_place(expected_vertices(outcome, terrain))).max() < 1e-3
        assert len(mesh.faces) == 2 * (SIZE - 1) ** 2
        assert (mesh.face_normals[:, 1] > 0.0).all()
        assert (mesh.vertex_normals[:, 1] > 0.0).all()
    assert obj.sidecar["mesh"]["error_measured"] <= 0.5e-4
    places, mesh = ground_of(obj)
    u, v = mesh.visual.uv.T
    column, row = np.rint(u * SIZE - 0.5), np.rint((1.0 - v) * SIZE - 0.5)
    assert np.abs(places[:, 0] - SPACING * column).max() < 1e-3
    assert np.abs(places[:, 1] - (1024.0 - SPACING * row)).max() < 1e-3


def test_adaptive_mesh_is_within_its_error(exported, terrain):
    for target, error in [("gltf", 0.25), ("gltf", 2.0), ("gltf", 20.0), ("obj", 1.0), ("stl", 1.0)]:
        outcome = exported(target, size=SIZE, error=error, plants=False)
        assert not outcome.paths("plant_points.glb")
        content = outcome.sidecar["mesh"]
        assert content["error_measured"] <= content["error_asked"] == error, (target, error)
        places, mesh = ground_of(outcome)
        faces = mesh.faces[mesh.face_normals[:, 2 if target == "stl" else 1] > 1e-9]
        assert len(faces) < 2 * (SIZE - 1) ** 2, (target, error)
        assert content["triangles"] == len(faces) or target == "stl", (target, error)
        assert target != "stl" or mesh.is_watertight
        x, y, z = expected_vertices(outcome, terrain).T
        surface = np.full(x.size, np.nan)
        for a, b, c in places[faces]:
            area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            wb = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
            wc = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
            inside = (wb > -1e-9) & (wc > -1e-9) & (wb + wc < 1.0 + 1e-9)
            surface[inside] = (a[2] + wb * (b[2] - a[2]) + wc * (c[2] - a[2]))[inside]
        assert np.abs(surface - z).max() == pytest.approx(content["error_measured"], abs=1e-3), (
            target,
            error,
        )


def test_glb_chunks_and_accessors_follow_the_specification(whole):
    for path in whole.paths(".glb"):
        content = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", content)
        assert (magic, version, length) == (b"glTF", 2, len(content))
        text, kind = struct.unpack_from("<I4s", content, 12)
        binary, other = struct.unpack_from("<I4s", content, 20 + text)
        assert (kind, other, text % 4, binary % 4) == (b"JSON", b"BIN\0", 0, 0)
        scene = json.loads(content[20 : 20 + text])
        assert scene["buffers"] == [{"byteLength": binary}]
        assert all(view["byteOffset"] % 4 == 0 for view in scene["bufferViews"])
        ends = [view["byteOffset"] + view["byteLength"] for view in scene["bufferViews"]]
        starts = [view["byteOffset"] for view in scene["bufferViews"][1:]] + [binary]
        assert all(end <= start < end + 4 for end, start in zip(ends, starts, strict=True))

    gltf = pygltflib.GLTF2().load(whole.paths("high_corner.glb")[0])
    for mesh in gltf.meshes:
        (primitive,) = mesh.primitives
        if primitive.indices is not None:
            assert gltf.accessors[primitive.indices].componentType == pygltflib.UNSIGNED_INT
        position = gltf.accessors[primitive.attributes.POSITION]
        values = accessor(gltf, primitive.attributes.POSITION)
        assert position.min == values.min(axis=0).tolist()
        assert position.max == values.max(axis=0).tolist()
        assert np.abs(np.linalg.norm(accessor(gltf, primitive.attributes.NORMAL), axis=1) - 1).max() < 1e-5


def test_baked_colours_match_materials(whole, terrain):
    gltf = pygltflib.GLTF2().load(whole.paths("high_corner.glb")[0])
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


def test_instances_match_plants(whole, plants):
    gltf = pygltflib.GLTF2().load(whole.paths("high_corner.glb")[0])
    assert gltf.extensionsUsed == [INSTANCING]
    assert not gltf.extensionsRequired
    rows = []
    for node in gltf.nodes:
        if not node.extensions:
            continue
        content = node.extensions[INSTANCING]["attributes"]
        position = accessor(gltf, content["TRANSLATION"]) + np.array(node.translation)
        spin, scale = accessor(gltf, content["ROTATION"]), accessor(gltf, content["SCALE"])
        assert (spin[:, [0, 2]] == 0.0).all()
        assert (position[0] == np.array(node.translation)).all()  # where the extension is not known
        turn = 2.0 * np.arctan2(spin[:, 1], spin[:, 3])
        assert (scale == scale[:, :1]).all()
        rows.append(np.column_stack([position[:, 0], -position[:, 2], position[:, 1], scale[:, 0], turn]))
    found = np.concatenate(rows)
    assert len(found) == len(plants) == whole.sidecar["plants"]["count"] > 500
    found, expected_vertices = (
        found[np.lexsort(found[:, :2].round(3).T)],
        plants[np.lexsort((plants["x"], plants["y"]))],
    )
    found = found[np.lexsort((found[:, 0], found[:, 1]))]
    for column, name, bound in ((0, "x", 1e-3), (1, "y", 1e-3), (3, "scale", 1e-6)):
        assert np.abs(found[:, column] - expected_vertices[name]).max() < bound
    assert np.abs(np.exp(1j * found[:, 4]) - np.exp(1j * expected_vertices["rotation"])).max() < 1e-5


def test_plant_models_have_their_origin_at_the_foot_and_true_size(whole):
    gltf = pygltflib.GLTF2().load(whole.paths("high_corner.glb")[0])
    names = {mesh.name: mesh for mesh in gltf.meshes if mesh.name.split()[0] in {"oak", "spruce", "birch"}}
    assert names
    for mesh in names.values():
        position = accessor(gltf, mesh.primitives[0].attributes.POSITION)
        assert 8.0 < position[:, 1].max() < 20.0
        assert -1.0 < position[:, 1].min() <= 0.05
        assert np.abs(position[:, [0, 2]].mean(axis=0)).max() < 1.5

    for species in ["grass", "flower", "fern"]:
        model = herb_model(species)
        assert model.position[:, 1].min() == 0.0 < 0.2 < model.position[:, 1].max() < 0.8, species
        assert (model.normal[:, 1] > 0.0).all(), species


def test_plant_points_match_plants(whole, plants):
    gltf = pygltflib.GLTF2().load(whole.paths("plant_points.glb")[0])
    assert not gltf.extensionsUsed
    count = 0
    for node in gltf.nodes:
        (primitive,) = gltf.meshes[node.mesh].primitives
        assert primitive.mode == pygltflib.POINTS
        position = accessor(gltf, primitive.attributes.POSITION).astype(float) + np.array(node.translation)
        of_species = plants[plants["species"] == ["spruce", "pine", "oak", "birch", "shrub"].index(node.name)]
        assert len(position) == len(of_species) == len(accessor(gltf, primitive.attributes._SCALE))
        assert np.sort(position[:, 0]) == pytest.approx(np.sort(of_species["x"]), abs=1e-3)
        assert np.sort(-position[:, 2]) == pytest.approx(np.sort(of_species["y"]), abs=1e-3)
        count += len(position)
    assert count == len(plants)


def test_water_meshes_match_rivers_and_lakes(whole, terrain):
    scene = trimesh.load(whole.paths("high_corner.glb")[0], process=False)
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
            ground = terrain.heights(x, -south, cell_size=1024.0 / (SIZE - 1))
            assert -0.5 <= up.max() - line[:, 2].max() <= 0.5 + max(0.0, ground.max() - line[:, 2].max())
            north = line[line[:, 1].argmax()]
            at = (-south).argmax()
            assert abs(x[at] - north[0]) < 40.0
            assert abs(-south[at] - north[1]) < 40.0


def test_oversized_and_invalid_scenes_are_refused(exported, monkeypatch, tmp_path):
    for error in (0.0, -1.0, float("nan"), 1e-9):
        refused("expected an error of a mesh", check_glb, ExportOptions(error=error))
    refused("4 GiB", check_glb, ExportOptions(size=16385))
    check_glb(ExportOptions(size=16385, error=1.0))

    monkeypatch.setattr("sketchterrain.export.gltf_plants.MAX_PLANTS", 100)
    refused("plants: a GLB holds 100: expected no grass", exported, "gltf", size=17)

    monkeypatch.setattr("sketchterrain.export.gltf.MAX_BYTES", 100)
    glb = GlbWriter()
    glb.attribute(np.zeros((20, 3), np.float32))
    refused("holds 4 GiB", glb.write, tmp_path / "large.glb")
    assert list(tmp_path.iterdir()) == []


def test_obj_names_its_objects_and_materials(obj, terrain):
    lines = obj.paths(".obj")[0].read_text(encoding="ascii").splitlines()
    (lake,), (river,) = terrain.features.lakes, terrain.features.rivers
    objects = [line[2:] for line in lines if line.startswith("o ")]
    assert objects == ["ground", f"lake_{lake.id}", f"river_{river.id}"]
    library = obj.paths(".mtl")[0].read_text(encoding="ascii")
    for line in lines:
        if line.startswith("usemtl "):
            assert f"newmtl {line[7:]}" in library
    picture = next(line[7:] for line in library.splitlines() if line.startswith("map_Kd "))
    with Image.open(obj.folder / picture) as image:
        assert image.size == (SIZE, SIZE)


def test_stl_is_a_closed_binary_solid(exported, terrain):
    stl = exported("stl", size=SIZE)
    mesh = trimesh.load(stl.paths(".stl")[0])
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    z = expected_vertices(stl, terrain)[:, 2]
    floor = stl.sidecar["mesh"]["floor"]
    assert mesh.bounds[0] == pytest.approx([0.0, 0.0, floor], abs=1e-3)
    assert mesh.bounds[1] == pytest.approx([1024.0, 1024.0, z.max()], abs=1e-3)
    assert floor == pytest.approx(z.min() - 0.02 * 1024.0, abs=1e-2)
    ground = np.unique(mesh.vertices[mesh.vertices[:, 2] > floor + 1.0], axis=0)
    assert np.abs(by_place(ground) - by_place(expected_vertices(stl, terrain))).max() < 1e-3

    content = stl.paths(".stl")[0].read_bytes()
    (count,) = struct.unpack_from("<I", content, 80)
    assert not content.startswith(b"solid")  # that would be text
    assert len(content) == 84 + 50 * count
    assert count == stl.sidecar["mesh"]["solid_triangles"]
    facets = np.frombuffer(content[84:], np.dtype([("floats", "<f4", 12), ("rest", "<u2")]))
    normal, a, b, c = np.moveaxis(facets["floats"].reshape(-1, 4, 3).astype(float), 1, 0)
    cross = np.cross(b - a, c - a)
    assert np.abs(normal - cross / np.linalg.norm(cross, axis=1, keepdims=True)).max() < 1e-4


@pytest.fixture(scope="module")
def blender(exported):
    return exported("blender", size=SIZE)


@pytest.fixture(scope="module")
def image(blender):
    with OpenEXR.File(str(blender.paths("_height.exr")[0]), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


def displaced(content, image):
    """Displace a grid as Blender does: U eastward, V northward, a picture's first row on top."""
    grid = content["displace_modifier"]["grid"]
    columns, rows = grid["x_subdivisions"] + 1, grid["y_subdivisions"] + 1
    v, u = (each.ravel() for each in np.mgrid[0 : 1 : rows * 1j, 0 : 1 : columns * 1j])
    x = (u - 0.5) * grid["size"] * grid["scale"]["x"] + grid["location"]["x"]
    y = (v - 0.5) * grid["size"] * grid["scale"]["y"] + grid["location"]["y"]
    high, wide = image.shape
    column = np.minimum((u * wide).astype(int), wide - 1)  # no interpolation, edges extended
    row = high - 1 - np.minimum((v * high).astype(int), high - 1)
    modifier = content["displace_modifier"]
    return x, y, modifier["strength"] * (image[row, column] - modifier["midlevel"])


def test_displaced_grid_and_glb_match_the_terrain(blender, image, terrain):
    assert all((channel == image["R"]).all() for channel in image.values())
    assert {channel.dtype.name for channel in image.values()} == {"float32"}
    x, y, z = displaced(blender.sidecar["import"], image["R"])
    assert np.abs(z - terrain.heights(x, y, cell_size=1024.0 / (SIZE - 1))).max() < 1e-3

    node = blender.sidecar["import"]["displacement_node"]
    plane, n = node["plane"], SIZE
    along = (np.arange(n) + 0.5) / n - 0.5
    x = along * plane["scale"]["x"] + plane["location"]["x"]
    y = -along * plane["scale"]["y"] + plane["location"]["y"]
    x, y = (each.ravel() for each in np.meshgrid(x, y))
    z = node["scale"] * (image["R"].ravel() - node["midlevel"])
    assert np.abs(z - terrain.heights(x, y, cell_size=1024.0 / (n - 1))).max() < 1e-3

    glb, _ = ground_of(blender)  # as Blender's importer turns it
    grid = np.stack(displaced(blender.sidecar["import"], image["R"]), axis=-1)
    assert np.abs(by_place(glb) - by_place(grid)).max() < 1e-3


def test_blender_plants_are_separate_instances_and_points(blender):
    names = [path.name for path in blender.paths(".glb")]
    assert sorted(names) == ["high_corner.glb", "high_corner_plant_points.glb", "high_corner_plants.glb"]
    scene = trimesh.load(blender.paths("corner.glb")[0], process=False)
    assert {name.split()[0] for name in scene.geometry} == {"ground", "river", "lake"}
    assert blender.sidecar["plants"]["count"] > 500
