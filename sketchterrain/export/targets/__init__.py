"""Where a terrain can be taken: one module a target, or a family of plain ones."""

from __future__ import annotations

from importlib import import_module

from sketchterrain.errors import InputError, one_line
from sketchterrain.export.target import Target

# Each in the module here that has it in its TARGETS: what a target needs is loaded when it is asked for.
_MODULES = {
    "unity": "unity",
    "unreal": "unreal",
    "godot": "godot",
    "blender": "blender",
    "gltf": "gltf",
    "geotiff": "geotiff",
    "raw": "plain",
    "png16": "plain",
    "exr": "plain",
    "npy": "plain",
    "obj": "meshes",
    "stl": "meshes",
}

TARGET_NAMES = tuple(_MODULES)
"""All that can be asked for, in the order in which they are listed."""


def target_named(name: str) -> Target:
    """Return a target.

    Raises
    ------
    InputError
        If there is no such target.
    """
    if name not in _MODULES:
        raise InputError(f"expected one of {', '.join(TARGET_NAMES)} as target, got {one_line(name)!r}")
    module = import_module(f"{__name__}.{_MODULES[name]}")
    found: Target = next(each for each in module.TARGETS if each.name == name)
    return found
