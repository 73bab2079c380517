"""Blender extension: import of terrains, and their refresh from a changed export."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ImportHelper

from .scene import FACTS, SOURCE, import_terrain, imported_terrains, refresh_terrain
from .source import SourceError, read_terrain


class ImportTerrain(bpy.types.Operator, ImportHelper):
    """Import a terrain that Sketchterrain has exported: its folder, terrain.json or GLB."""

    bl_idname = "import_scene.sketchterrain"
    bl_label = "Import Sketchterrain"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012
    filter_glob: bpy.props.StringProperty(default="*.json;*.glb", options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: Any) -> set[str]:
        """Read and build the terrain."""
        try:
            import_terrain(context, read_terrain(Path(bpy.path.abspath(self.filepath))))
        except SourceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class RefreshTerrain(bpy.types.Operator):
    """Read the export again; keep what was added or changed in Blender."""

    bl_idname = "sketchterrain.refresh"
    bl_label = "Refresh"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012
    collection: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: Any) -> set[str]:
        """Read the export of a collection and replace its data."""
        try:
            found = bpy.data.collections.get(self.collection)
            if found is None or SOURCE not in found:
                raise SourceError(f"{self.collection!r}: expected the collection of an imported terrain")
            kept = refresh_terrain(context, found, read_terrain(Path(bpy.path.abspath(found[SOURCE]))))
        except SourceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if kept:
            self.report({"INFO"}, f"kept as changed: {', '.join(kept)}")
        return {"FINISHED"}


class TerrainPanel(bpy.types.Panel):
    """Imported terrains, and their exports."""

    bl_idname = "VIEW3D_PT_sketchterrain"
    bl_label = "Sketchterrain"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Sketchterrain"

    def draw(self, _context: Any) -> None:
        """Show where each terrain is from and what it has."""
        self.layout.operator(ImportTerrain.bl_idname, text="Import…", icon="IMPORT")
        for collection in imported_terrains():
            box = self.layout.box()
            box.label(text=collection.name, icon="WORLD")
            box.prop(collection, f'["{SOURCE}"]', text="From")
            for line in collection[FACTS].splitlines():
                box.label(text=line)
            operator = box.operator(RefreshTerrain.bl_idname, icon="FILE_REFRESH")
            operator.collection = collection.name


def build_file(arguments: list[str]) -> int:
    """Write a .blend file with a terrain: ``blender -c sketchterrain FOLDER -o FILE.blend``."""
    parser = argparse.ArgumentParser(
        "blender -c sketchterrain", description="Import a terrain into a new file."
    )
    parser.add_argument("source", type=Path, help="an export's folder, its terrain.json or a GLB")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.blend")
    given = parser.parse_args(arguments)
    try:
        source = read_terrain(given.source.absolute())
        for each in list(bpy.data.objects):  # of the startup file
            bpy.data.objects.remove(each)
        import_terrain(bpy.context, source)
        bpy.ops.wm.save_as_mainfile(filepath=str(given.output.absolute()))
        bpy.ops.file.make_paths_relative()
        bpy.ops.wm.save_mainfile()
    except (SourceError, RuntimeError) as error:
        print(f"sketchterrain: {error}".strip())  # noqa: T201 - a command of Blender's
        return 1
    return 0


def _menu_entry(menu: Any, _context: Any) -> None:
    menu.layout.operator(ImportTerrain.bl_idname, text="Sketchterrain (folder, terrain.json, .glb)")


_CLASSES = (ImportTerrain, RefreshTerrain, TerrainPanel)
_commands: list[Any] = []


def register() -> None:
    """Add operators, menu entry, panel and command."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    bpy.types.TOPBAR_MT_file_import.append(_menu_entry)
    _commands.append(bpy.utils.register_cli_command("sketchterrain", build_file))


def unregister() -> None:
    """Remove them."""
    bpy.utils.unregister_cli_command(_commands.pop())
    bpy.types.TOPBAR_MT_file_import.remove(_menu_entry)
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
