"""Export targets, one module each or per family of plain formats."""

from importlib import import_module

from sketchterrain.errors import InputError, one_line
from sketchterrain.export.target import Target

# Module of each target, which is loaded on first use.
_MODULES = {
    "unity": "unity",
    "unreal": "unreal",
    "godot": "godot",
    "blender": "gltf",
    "gltf": "gltf",
    "web": "web",
    "geotiff": "geotiff",
    "qgis": "qgis",
    "raw": "plain",
    "png16": "plain",
    "exr": "plain",
    "npy": "plain",
    "obj": "meshes",
    "stl": "meshes",
}

TARGET_NAMES = tuple(_MODULES)


def target_named(name: str) -> Target:
    """Return a target, or raise `InputError`."""
    if name not in _MODULES:
        raise InputError(f"expected one of {', '.join(TARGET_NAMES)} as target, got {one_line(name)!r}")
    module = import_module(f"{__name__}.{_MODULES[name]}")
    target: Target = next(target for target in module.TARGETS if target.name == name)
    return target
