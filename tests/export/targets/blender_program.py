"""Run in Blender's Python by test_blender_extension.py: steps with the extension, facts as JSON on stdout."""

import json
import shutil
import sys
from contextlib import redirect_stdout
from pathlib import Path

import bpy
import numpy as np

PARENT, WORK = Path(sys.argv[-3]), Path(sys.argv[-2])
STEPS = sys.argv[-1].split(",")
sys.path.insert(0, str(PARENT))
import blender_extension as extension  # noqa: E402


def blocks():
    """Names of all data blocks that the extension makes."""
    kinds = ("objects", "meshes", "materials", "images", "node_groups", "worlds", "collections", "lights")
    return {kind: sorted(block.name for block in getattr(bpy.data, kind)) for kind in kinds}


def run_import(path):
    return bpy.ops.import_scene.sketchterrain("EXEC_DEFAULT", True, filepath=str(path))


def problem(function, *arguments, **named):
    try:
        function(*arguments, **named)
    except RuntimeError as error:
        return str(error).strip()
    return None


def ground_heights(place):
    ground = bpy.data.objects["ground"]
    values = np.empty(3 * len(ground.data.vertices), np.float32)
    ground.data.vertices.foreach_get("co", values)
    np.save(WORK / place, values.reshape(-1, 3) + np.array(ground.location))


def instances(place):
    """Instances of each level of detail, and the least distance of each from the camera."""
    graph = bpy.context.evaluated_depsgraph_get()
    found = [
        (each.object.name, each.matrix_world.to_translation())
        for each in graph.object_instances
        if each.is_instance
    ]
    levels = {}
    for name, _ in found:
        levels[name[-1]] = levels.get(name[-1], 0) + 1
    eye = bpy.context.scene.camera.location
    nearest = {level: min((p - eye).length for name, p in found if name[-1] == level) for level in levels}
    np.save(WORK / place, [tuple(place) for _, place in found])
    return {"levels": levels, "nearest": nearest}


def imported():
    before = blocks()
    assert run_import(WORK / "first") == {"FINISHED"}
    facts = blocks() | {"instances": instances("plants.npy")}
    ground = bpy.data.objects["ground"].data
    facts["ground_nodes"] = sorted(
        node.node_tree.name
        for node in ground.materials[0].node_tree.nodes
        if node.bl_idname == "ShaderNodeGroup"
    )
    model = next(each for each in bpy.data.objects if each.name.startswith("000 "))
    facts["model"] = [list(corner) for corner in model.bound_box]
    scene = bpy.context.scene
    facts["camera"] = {
        "matrix": [list(row) for row in scene.camera.matrix_basis],
        "fov": scene.camera.data.angle_y,
    }
    sun = next(each for each in bpy.data.objects if each.type == "LIGHT")
    facts["sun"] = list(sun.matrix_basis.to_3x3() @ extension.scene.Vector((0.0, 0.0, 1.0)))
    ground_heights("ground.npy")
    bpy.ops.ed.undo()
    facts["undone"] = blocks() == before
    bpy.ops.ed.redo()
    facts["redone"] = "ground" in bpy.data.objects
    return facts


def refreshed():
    """Change things as an artist does, exchange the export, refresh."""
    (collection,) = extension.imported_terrains()
    own = bpy.data.objects.new("cabin", None)
    collection.objects.link(own)
    ground = bpy.data.objects["ground"]
    ground.modifiers.new("own", "SMOOTH")
    bump = ground.data.materials[0].node_tree.nodes["Bump"].inputs["Strength"]
    bump.default_value = 0.25
    bpy.context.scene.camera.data.lens = 21.0
    bpy.data.objects.remove(bpy.data.objects["sun"])
    before = len(ground.data.vertices)
    folder = Path(collection[extension.SOURCE])
    unchanged = bpy.ops.sketchterrain.refresh(collection=collection.name)
    same = len(ground.data.vertices) == before
    shutil.rmtree(folder)
    shutil.copytree(WORK / "second", folder)
    assert unchanged == bpy.ops.sketchterrain.refresh(collection=collection.name) == {"FINISHED"}
    ground = bpy.data.objects["ground"]
    ground_heights("refreshed.npy")
    return {
        "same": same,
        "objects": sorted(each.name for each in collection.all_objects),
        "modifiers": [each.name for each in ground.modifiers],
        "strength": ground.data.materials[0].node_tree.nodes["Bump"].inputs["Strength"].default_value,
        "lens": bpy.context.scene.camera.data.lens,
        "plants": len(bpy.data.objects["plants"].data.vertices),
        "instances": instances("refreshed_plants.npy"),
    }


def refused():
    """Report the line of each bad input, and whether it changed anything."""
    found = {}
    for folder in sorted((WORK / "bad").iterdir()):
        before = blocks()
        found[folder.name] = [problem(run_import, folder), blocks() == before]
    return found


def written():
    """Write a .blend by the command."""
    code = extension.build_file([str(WORK / "first"), "-o", str(WORK / "scene.blend")])
    bpy.ops.wm.open_mainfile(filepath=str(WORK / "scene.blend"))
    paths = [each.filepath for each in bpy.data.images if each.source == "FILE"]
    bad = extension.build_file([str(WORK / "bad" / "half"), "-o", str(WORK / "bad.blend")])
    return {"code": code, "bad": bad, "objects": blocks()["objects"], "images": paths}


def alone():
    """Import a GLB without a sidecar, and a folder of --to gltf with an adaptive mesh."""
    found = {}
    for name in ("alone.glb", "gltf"):
        assert run_import(WORK / name) == {"FINISHED"}
        collection = extension.imported_terrains()[0]
        graph = bpy.context.evaluated_depsgraph_get()
        ground = bpy.data.objects["ground"]
        images = sorted(tuple(each.size) for each in bpy.data.images if each.packed_file)
        found[name] = {
            "instances": sum(each.is_instance for each in graph.object_instances),
            "vertices": len(ground.data.vertices),
            "own_normals": ground.data.has_custom_normals,
            "images": images,
        }
        for each in list(collection.all_objects):
            bpy.data.objects.remove(each)
        bpy.data.collections.remove(collection)
    return found


def rendered():
    """Render the scene's camera with Cycles."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 4, True
    scene.render.resolution_x, scene.render.resolution_y = 480, 270
    scene.render.filepath = str(WORK / "render.png")
    bpy.ops.render.render(write_still=True)
    return {}


extension.register()
try:
    with redirect_stdout(sys.stderr):
        for startup in list(bpy.data.objects):
            bpy.data.objects.remove(startup)
        bpy.ops.ed.undo_push(message="start")
        facts = {step: globals()[step]() for step in STEPS}
finally:
    extension.unregister()
sys.stdout.write(json.dumps(facts) + "\n")
