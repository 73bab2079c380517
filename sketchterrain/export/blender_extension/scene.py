"""Data blocks of a terrain: meshes, plants, materials, light and camera; import and refresh."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from . import materials
from .source import MeshSource, SourceError, TerrainSource

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
    return [each for each in bpy.data.collections if SOURCE in each]


def import_terrain(context: Any, source: TerrainSource) -> Any:
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


def refresh_terrain(context: Any, collection: Any, source: TerrainSource) -> list[str]:
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


def _stem(source: TerrainSource) -> str:
    return source.name.encode()[:_NAME].decode(errors="ignore").strip() or "terrain"


class _Builder:
    def __init__(self, context: Any, collection: Any, source: TerrainSource) -> None:
        self.context, self.collection, self.source = context, collection, source
        self.stem, self.kept = _stem(source), list[str]()
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
            self._camera(self._scene["camera"])
            self._sun(self._scene["sun"], self._scene["sunlight"])
            self._sky()
        for part, left in self._there.items():
            if part not in self._parts:  # no longer in the export
                bpy.data.objects.remove(left)
        self.collection[_KNOWN] = "\n".join(sorted(self._known | self._parts))
        self.collection[SOURCE] = str(self.source.path)
        self.collection[FACTS] = "\n".join(self._facts())

    def set_scene(self) -> None:
        """Set what belongs to the whole scene, only once: camera, world, exposure, units, clipping."""
        scene = self.context.scene
        scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1.0
        reach = 10.0 * self._extent()
        for window in self.context.window_manager.windows:
            for area in window.screen.areas:
                if area.type == "VIEW_3D":
                    area.spaces.active.clip_end = max(area.spaces.active.clip_end, reach)
        if self._scene is not None:
            scene.camera = self._object("camera", "camera", None)
            scene.world = bpy.data.worlds[f"{self.stem} sky"]
            scene.view_settings.view_transform, scene.view_settings.look = "Khronos PBR Neutral", "None"
            scene.view_settings.exposure = _STOPS + math.log2(self._scene["exposure"] / _WATTS)

    def _facts(self) -> Iterator[str]:
        sidecar, ground = self.source.sidecar, self.source.ground
        if sidecar:
            yield f"seed {sidecar['seed']}, {sidecar['program']}"
        yield f"ground: {len(ground.position):,} vertices, {len(ground.indices):,} triangles"
        yield f"objects: {len(self.source.meshes) - 1}, materials of the ground: {len(self._tiles)}"
        yield f"plants: {sum(len(each.position) for each in self.source.plants):,}"

    def _extent(self) -> float:
        return float(np.ptp(self.source.ground.position, axis=0).max())

    def _rebuild(self, block: Any, build: Callable[..., None], *arguments: Any) -> None:
        if not materials.rebuild(block, build, *arguments):
            self.kept.append(block.name)

    def _object(self, part: str, name: str, data: Any, *, into: Any = None) -> Any:
        """Return the object of a part, a new one if the part is new, None if the artist deleted it."""
        self._parts.add(part)
        if part not in self._there:
            if part in self._known and into is None:
                return None
            self._there[part] = bpy.data.objects.new(name, data() if callable(data) else data)
            self._there[part][_PART] = part
            (into or self.collection).objects.link(self._there[part])
        return self._there[part]

    def _mesh_object(self, source: MeshSource, material: Any) -> None:
        part = f"{source.name} {source.material}"
        found = self._object(part, source.name, lambda: self._new_mesh(part, material))
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
        is_smooth = source is self.source.ground and not _mesh_error(self.source)
        fill_mesh(found.data, source, own_normals=not is_smooth)

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
    ) -> tuple[Callable[..., None], tuple[Any, ...]]:
        """Return the function that builds a material, and its arguments."""
        if name == "ground" and self._tiles:
            weights = {
                file: self._image(file, is_data=True) for file in {e["weights"]: 0 for e in self._tiles}
            }
            files = [entry["file"] for entry in self.source.sidecar["files"]]
            painted = [self._image(file) for file in files if file.endswith("_appearance.png")]
            return materials.build_ground, (self._tiles, groups, weights, painted)
        if name == "ground":
            baked = {"colour": False, "roughness": True}
            images = [
                materials.load_image(
                    f"{self.stem} {part}", self.source.baked[f"ground {part}"], is_data=is_data
                )
                for part, is_data in baked.items()
            ]
            return materials.build_baked_ground, tuple(images)
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
        deepest = max(len(each.levels) for each in self.source.plants)
        number = 0
        for plant in self.source.plants:
            for level in range(deepest):
                part = f"model {plant.name} {level + 1}"
                model = self._object(part, part, lambda p=part: self._new_mesh(p, material), into=models)
                model.name = f"{number:03d} {plant.name} level {level + 1}"  # instances count by name
                self._fill(model, part, plant.levels[min(level, len(plant.levels) - 1)])
                number += 1
        points = self._object("plants", "plants", lambda: self._new_mesh("plants", material))
        if points is None:
            return
        centre = np.array(self.source.ground.location)
        columns = [(each.position - centre, each.rotation, each.scale) for each in self.source.plants]
        place, turn, scale = (np.concatenate(column) for column in zip(*columns, strict=True))
        counts = [len(each.position) for each in self.source.plants]
        model = np.repeat(deepest * np.arange(len(counts)), counts)
        if points.data.get(_PART) == "plants":
            fill_points(points.data, place, {"rotation": turn, "scale": scale, "model": model})
        self._rebuild(points, _move, centre)
        tree = self._group("instances", "GeometryNodeTree")
        is_new = materials.STATE not in tree
        self._rebuild(tree, materials.build_instances, _NEAR, _FAR)
        if is_new:
            modifier = points.modifiers.new("instances", "NODES")
            modifier.node_group = tree
            sockets = {
                each.name: each.identifier for each in tree.interface.items_tree if each.in_out == "INPUT"
            }
            modifier[sockets["Models"]] = models

    def _camera(self, facts: dict[str, Any]) -> None:
        camera = self._object("camera", "camera", lambda: bpy.data.cameras.new(f"{self.stem} camera"))
        eye, target = Vector(facts["eye"]), Vector(facts["target"])

        def build(found: Any) -> None:
            found.location = eye
            found.rotation_euler = (target - eye).to_track_quat("-Z", "Y").to_euler()
            found.data.sensor_fit = "VERTICAL"
            found.data.angle_y = math.radians(facts["vertical_fov"])
            found.data.clip_start, found.data.clip_end = 0.5, 10.0 * self._extent()

        if camera is not None:
            self._rebuild(camera, build)

    def _sun(self, facts: dict[str, float], light: list[float]) -> None:
        sun = self._object("sun", "sun", lambda: bpy.data.lights.new(f"{self.stem} sun", "SUN"))
        azimuth, elevation = math.radians(facts["azimuth"]), math.radians(facts["elevation"])
        level = math.cos(elevation)
        towards = Vector((math.sin(azimuth) * level, math.cos(azimuth) * level, math.sin(elevation)))

        def build(found: Any) -> None:
            found.location = self.source.ground.location
            found.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
            found.data.energy = _WATTS * max(light)
            found.data.color = [each / max(light) for each in light] if max(light) else (1.0, 1.0, 1.0)
            found.data.angle = _SUN_ANGLE

        if sun is not None:
            self._rebuild(sun, build)

    def _sky(self) -> None:
        name = f"{self.stem} sky"
        world = bpy.data.worlds.get(name) or bpy.data.worlds.new(name)
        self._rebuild(world, materials.build_world, self._scene, _WATTS)


def _move(found: Any, location: Any) -> None:
    found.location = location


def _mesh_error(source: TerrainSource) -> float:
    return float(source.sidecar.get("mesh", {}).get("error_measured", 1.0))


def _layer_of(layer: Any, collection: Any) -> Any:
    found = (_layer_of(child, collection) for child in layer.children)
    return (
        layer if layer.collection == collection else next((each for each in found if each is not None), None)
    )


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
