"""Export targets, one module each or per family of plain formats."""

from importlib import import_module

from sketchterrain.errors import InputError, one_line
from sketchterrain.export.target import Target

# Targets of each module, which is loaded on first use.
_MODULES = {
    **{name: (name,) for name in ("unity", "unreal", "godot")},
    "gltf": ("blender", "gltf"),
    **{name: (name,) for name in ("web", "geotiff", "qgis")},
    "plain": ("raw", "png16", "exr", "npy"),
    "meshes": ("obj", "stl"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

TARGET_NAMES = tuple(_MODULE_OF)


def target_named(name: str) -> Target:
    """Return a target, or raise `InputError`."""
    if name not in _MODULE_OF:
        raise InputError(f"expected one of {', '.join(TARGET_NAMES)} as target, got {one_line(name)!r}")
    module = import_module(f"{__name__}.{_MODULE_OF[name]}")
    target: Target = next(target for target in module.TARGETS if target.name == name)
    return target
