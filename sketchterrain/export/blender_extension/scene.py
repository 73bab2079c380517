"""Data blocks of a terrain: meshes, plants, materials, light and camera; import and refresh."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Vector

from . import materials
from .source import MeshSource, SourceError, TerrainExport

SOURCE = "sketchterrain_source"  # properties of a terrain's collection: path of the export,
FACTS = "sketchterrain_facts"  # lines about it,
_SKETCH = "sketchterrain_sketch"  # name of its sketch,
_KNOWN = "sketchterrain_known"  # and parts that were imported
_PART = "sketchterrain_part"  # property of an object and its mesh: what it is in the export
_NEAR, _FAR = 150.0, 500.0  # m from the camera, between levels of detail
_WATTS = 8.0  # of Blender's physical sky (W/m²) in the sketch's unit of light
_STOPS = -0.3  # of the view transform, to be as bright as the preview
_NAME = 30  # bytes of a sketch's name in names of data blocks, which have 63
_IMAGE_NAME = 60  # characters of a file's name
_SUN_ANGLE = math.radians(0.53)


def imported_terrains() -> list[Any]:
    """Return the collections of imported terrains in this file."""
    return [each for each in bpy.data.collections if SOURCE in each and each.users]


def import_terrain(context: Any, source: TerrainExport) -> Any:
    """Build a terrain in a new collection of the scene; raise `SourceError` if the file has it already."""
    stem = _stem(source)
    if any(each.get(_SKETCH) == stem for each in imported_terrains()):
        raise SourceError(f"this file has the terrain {stem!r} already: use Refresh in the sidebar")
    collection = bpy.data.collections.new(stem)
    context.scene.collection.children.link(collection)
    collection[_SKETCH] = stem
    builder = _Builder(context, collection, source)
    builder.build()
    builder.set_scene()
    return collection


def refresh_terrain(context: Any, collection: Any, source: TerrainExport) -> list[str]:
    """Replace the data of a terrain by those of a new export; return the names of what the artist changed.

    Meshes, images and plants are replaced in their data blocks. Materials, sky, camera, sun and transforms
    are replaced only if they are as they were imported; objects that were deleted stay deleted.
    """
    stem = _stem(source)
    if collection[_SKETCH] != stem:
        raise SourceError(f"{source.path}: an export of {stem!r}: expected one of {collection[_SKETCH]!r}")
    builder = _Builder(context, collection, source)
    builder.build()
    return builder.kept


def _stem(source: TerrainExport) -> str:
    return source.name.encode()[:_NAME].decode(errors="ignore").strip() or "terrain"


class _Builder:
    def __init__(self, context: Any, collection: Any, source: TerrainExport) -> None:
        self.context, self.collection, self.source = context, collection, source
        self.stem, self.kept = _stem(source), list[str]()
        self._sky = f"{self.stem} sky"
        self._there = {each[_PART]: each for each in collection.all_objects if _PART in each}
        self._known = set(collection.get(_KNOWN, "").split("\n"))
        self._parts = set[str]()
        self._scene, self._tiles = source.sidecar.get("scene"), source.sidecar.get("tiles_of_materials", [])

    def build(self) -> None:
        surfaces = self._materials()
        for mesh in self.source.meshes:
            self._mesh_object(mesh, surfaces[mesh.material])
        if self.source.plants:
            self._plants(surfaces["plants"])
        if self._scene is not None:
            camera, sun = self._scene["camera"], self._scene["sun"]
            lens, lamp = (f"{self.stem} {kind}" for kind in ("camera", "sun"))
            self._equip("camera", lambda: bpy.data.cameras.new(lens), _set_camera, camera, self._reach())
            light = (sun, self._scene["sunlight"], self.source.ground.location)
            self._equip("sun", lambda: bpy.data.lights.new(lamp, "SUN"), _set_sun, *light)
            world = bpy.data.worlds.get(self._sky) or bpy.data.worlds.new(self._sky)
            self._rebuild(world, materials.build_world, self._scene, _WATTS)
        for part, left in self._there.items():
            if part not in self._parts:  # no longer in the export
                bpy.data.objects.remove(left)
        self.collection[_KNOWN] = "\n".join(sorted(self._known | self._parts))
        self.collection[SOURCE] = str(self.source.path)
        self.collection.id_properties_ui(SOURCE).update(subtype="DIR_PATH")
        self.collection[FACTS] = "\n".join(self._facts())

    def set_scene(self) -> None:
        """Set what belongs to the whole scene, only once: camera, world, exposure, units, clipping."""
        scene = self.context.scene
        scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1.0
        areas = [area for window in self.context.window_manager.windows for area in window.screen.areas]
        for view in (area.spaces.active for area in areas if area.type == "VIEW_3D"):
            view.clip_end = max(view.clip_end, self._reach())
        if self._scene is not None:
            scene.camera, scene.world = self._there["camera"], bpy.data.worlds[self._sky]
            scene.view_settings.view_transform, scene.view_settings.look = "Khronos PBR Neutral", "None"
            scene.view_settings.exposure = _STOPS + math.log2(self._scene["exposure"] / _WATTS)

    def _facts(self) -> Iterator[str]:
        sidecar, ground = self.source.sidecar, self.source.ground
        if sidecar:
            yield f"seed {sidecar['seed']}, {sidecar['program']}"
        yield f"ground: {len(ground.position):,} vertices, {len(ground.indices):,} triangles"
        yield f"objects: {len(self.source.meshes) - 1}, materials of the ground: {len(self._tiles)}"
        yield f"plants: {sum(len(each.position) for each in self.source.plants):,}"

    def _reach(self) -> float:
        return 10.0 * float(np.ptp(self.source.ground.position, axis=0).max())

    def _rebuild(self, block: Any, build: Callable[..., None], *arguments: Any) -> None:
        if not materials.rebuild(block, build, *arguments):
            self.kept.append(block.name)

    def _object(self, part: str, name: str, data: Callable[[], Any], *, into: Any = None) -> Any:
        """Return the object of a part, a new one if the part is new, None if the artist deleted it."""
        self._parts.add(part)
        if part not in self._there:
            if part in self._known and into is None:
                return None
            self._there[part] = bpy.data.objects.new(name, data())
            self._there[part][_PART] = part
            (into or self.collection).objects.link(self._there[part])
        return self._there[part]

    def _equip(self, part: str, data: Callable[[], Any], build: Callable[..., None], *arguments: Any) -> None:
        found = self._object(part, part, data)
        if found is not None:
            self._rebuild(found, build, *arguments)

    def _mesh_object(self, source: MeshSource, material: Any) -> None:
        kind = "" if source.indices.shape[1] == 3 else " lines" if len(source.indices) else " points"
        part = f"{source.name} {source.material}{kind}"
        found = self._object(part, source.name, partial(self._new_mesh, part, material))
        if found is not None:
            self._fill(found, part, source)
            self._rebuild(found, _move, source.location)

    def _new_mesh(self, part: str, material: Any) -> Any:
        mesh = bpy.data.meshes.new(f"{self.stem} {part}")
        mesh[_PART] = part
        mesh.materials.append(material)
        return mesh

    def _fill(self, found: Any, part: str, source: MeshSource) -> None:
        """Replace the content of a mesh unless the artist gave the object another one."""
        if found.data.get(_PART) != part:
            self.kept.append(found.name)
            return
        is_whole = source is self.source.ground and not self.source.mesh_error
        fill_mesh(found.data, source, own_normals=not is_whole)

    def _materials(self) -> dict[str, Any]:
        """Return the material of each name in the export, built unless it was changed."""
        groups, air = {}, None
        if self._scene is not None:
            air = self._group("air")
            self._rebuild(air, materials.build_air, self._scene["air"], _WATTS)
        for tile in self._tiles:
            group = groups[tile["material"]] = self._group(tile["title"])
            self._rebuild(group, materials.build_tile, tile, self._image(tile["file"]))
        found = {}
        for name, colour in self.source.colours.items():
            full = f"{self.stem} {name}"
            found[name] = bpy.data.materials.get(full) or bpy.data.materials.new(full)
            build, arguments = self._look(name, colour, groups)
            self._rebuild(found[name], build, air, *arguments)
        return found

    def _look(
        self, name: str, colour: tuple[float, ...], groups: dict[str, Any]
    ) -> tuple[Any, tuple[Any, ...]]:
        """Return the function that builds a material, and its arguments."""
        if name == "ground" and self._tiles:
            weights = {tile["weights"]: self._image(tile["weights"], is_data=True) for tile in self._tiles}
            files = [entry["file"] for entry in self.source.sidecar["files"]]
            painted = [self._image(file) for file in files if file.endswith("_appearance.png")]
            return materials.build_ground, (self._tiles, groups, weights, painted)
        if name == "ground":
            baked, load = self.source.baked, materials.load_image
            mean = load(f"{self.stem} colour", baked["ground colour"])
            rough = load(f"{self.stem} roughness", baked["ground roughness"], is_data=True)
            return materials.build_baked_ground, (mean, rough)
        if name in ("water", "plants"):
            return {"water": materials.build_water, "plants": materials.build_plants}[name], ()
        return materials.build_solid, (colour, groups.get(name))

    def _group(self, name: str, kind: str = "ShaderNodeTree") -> Any:
        name = f"{self.stem} {name}"
        return bpy.data.node_groups.get(name) or bpy.data.node_groups.new(name, kind)

    def _image(self, file: str, *, is_data: bool = False) -> Any:
        return materials.load_image(file[-_IMAGE_NAME:], self.source.path / file, is_data=is_data)

    def _plants(self, material: Any) -> None:
        children = [each for each in self.collection.children if _PART in each]
        models = children[0] if children else bpy.data.collections.new(f"{self.stem} models")
        if not children:
            models[_PART] = "models"
            self.collection.children.link(models)
            self.context.view_layer.update()
            _layer_of(self.context.view_layer.layer_collection, models).exclude = True
        plants, number = self.source.plants, 0
        deepest = max(len(each.levels) for each in plants)
        for plant in plants:
            for level in range(deepest):
                part = f"model {plant.name} {level + 1}"
                model = self._object(part, part, partial(self._new_mesh, part, material), into=models)
                model.name = f"{number:03d} {plant.name} level {level + 1}"  # instances count by name
                self._fill(model, part, plant.levels[min(level, len(plant.levels) - 1)])
                number += 1
        is_new = "plants" not in self._there
        points = self._object("plants", "plants", partial(self._new_mesh, "plants", material))
        if points is None:
            return
        centre = np.array(self.source.ground.location)
        place = np.concatenate([each.position - centre for each in plants])
        turn, scale = (
            np.concatenate(each) for each in zip(*((p.rotation, p.scale) for p in plants), strict=True)
        )
        model = np.repeat(deepest * np.arange(len(plants)), [len(each.position) for each in plants])
        if points.data.get(_PART) == "plants":
            fill_points(points.data, place, {"rotation": turn, "scale": scale, "model": model})
        self._rebuild(points, _move, centre)
        tree = self._group("instances", "GeometryNodeTree")
        self._rebuild(tree, materials.build_instances, _NEAR, _FAR)
        if is_new:
            modifier = points.modifiers.new("instances", "NODES")
            modifier.node_group = tree
            sockets = {each.name: each.identifier for each in tree.interface.items_tree}
            modifier[sockets["Models"]] = models


def _move(found: Any, location: Any) -> None:
    found.location = location


def _set_camera(camera: Any, facts: dict[str, Any], reach: float) -> None:
    eye, target = Vector(facts["eye"]), Vector(facts["target"])
    camera.location, camera.rotation_euler = eye, (target - eye).to_track_quat("-Z", "Y").to_euler()
    camera.data.sensor_fit, camera.data.angle_y = "VERTICAL", math.radians(facts["vertical_fov"])
    camera.data.clip_start, camera.data.clip_end = 0.5, reach


def _set_sun(sun: Any, facts: dict[str, float], light: list[float], location: Any) -> None:
    turn = Euler((math.radians(90.0 - facts["elevation"]), 0.0, math.radians(180.0 - facts["azimuth"])))
    sun.location, sun.rotation_euler = location, turn
    sun.data.energy, sun.data.angle = _WATTS * max(light), _SUN_ANGLE
    sun.data.color = [each / max(*light, 1e-9) for each in light]


def _layer_of(layer: Any, collection: Any) -> Any:
    if layer.collection == collection:
        return layer
    found = (_layer_of(child, collection) for child in layer.children)
    return next((each for each in found if each is not None), None)


def fill_mesh(mesh: Any, source: MeshSource, *, own_normals: bool) -> None:
    """Replace the geometry of a mesh; its materials stay."""
    mesh.clear_geometry()
    mesh.vertices.add(len(source.position))
    mesh.vertices.foreach_set("co", _flat(source.position))
    if source.indices.shape[1] == 3:
        corners = source.indices.ravel()
        mesh.loops.add(len(corners))
        mesh.loops.foreach_set("vertex_index", corners)
        mesh.polygons.add(len(source.indices))
        mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
    else:
        mesh.edges.add(len(source.indices))
        mesh.edges.foreach_set("vertices", source.indices.ravel())
    mesh.update(calc_edges=True)
    if source.uv is not None:
        layer = mesh.uv_layers.new(name="UVMap")
        layer.uv.foreach_set("vector", _flat(source.uv[corners]))
    if source.colour is not None:
        colours = mesh.color_attributes.new("colour", "FLOAT_COLOR", "POINT")
        colours.data.foreach_set("color", _flat(source.colour))
    if own_normals and source.normal is not None:
        mesh.normals_split_custom_set_from_vertices(source.normal)


def fill_points(mesh: Any, position: Any, attributes: dict[str, Any]) -> None:
    """Replace the content of a mesh by points with attributes."""
    mesh.clear_geometry()
    mesh.vertices.add(len(position))
    mesh.vertices.foreach_set("co", _flat(position))
    for name, values in attributes.items():
        kind, dtype = ("INT", np.int32) if name == "model" else ("FLOAT", np.float32)
        mesh.attributes.new(name, kind, "POINT").data.foreach_set("value", values.astype(dtype))
    mesh.update()


def _flat(values: Any) -> Any:
    return np.ascontiguousarray(values, np.float32).ravel()
