"""Materials that a sketch declares itself: a pattern of the program with other colours, or pictures."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

from sketchterrain.errors import InputError, format_value
from sketchterrain.features.table import FeatureTable
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.materials import BUILT_IN, MATERIALS, Material, MaterialTable
from sketchterrain.schema.parameters import LOOK, Parameter, Properties, check_values, parameter_table
from sketchterrain.schema.styles import rgb_from_hex

MAX_MATERIALS: Final = 16
"""The most materials of a sketch, the program's included."""

OWN: Final = parameter_table(
    Parameter(
        *("like", str, "soil", 0, 40, "", "the material whose pattern, stones and plants it has"),
        choices=MATERIALS,
    ),
    *LOOK.values(),
    Parameter(
        *("folder", str, "", 0, 400, ""),
        "folder of its pictures beside the sketch; empty is the pattern's own",
    ),
)
"""Keys of ``[materials.NAME]``."""

_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,39}")
_SUFFIXES: Final = (".png", ".jpg", ".jpeg")
_WORDS: Final = {
    "albedo": ("albedo", "color", "colour", "basecolor", "diffuse", "diff", "col"),
    "height": ("height", "displacement", "disp"),
    "slopes": ("normal", "normalgl", "nor", "nrm"),
    "roughness": ("roughness", "rough"),
}
"""Words of file names by content, as in ``Bricks_Color.jpg`` and ``bricks_rough_1k.png``."""
_PALE: Final = 0.55  # share of white in the colour on maps


def check_own_materials(given: Mapping[str, Mapping[str, object]]) -> Mapping[str, Properties]:
    """Return checked values of a sketch's own materials; raise InputError."""
    checked = {}
    for name, values in given.items():
        where = f"[materials.{format_value(name)}]"
        if not _NAME.fullmatch(name):
            raise InputError(f"{where}: expected a name of at most 40 small letters, digits and _")
        if name in BUILT_IN.layers:
            raise InputError(
                f"{where}: expected a new name, the program has this material: see [look.{name}]"
            )
        checked[name] = MappingProxyType(check_values(values, OWN, where, f"materials.{name}."))
    if len(BUILT_IN) + len(checked) > MAX_MATERIALS:
        most = MAX_MATERIALS - len(BUILT_IN)
        raise InputError(f"{len(checked)} [materials]: expected at most {most}, {MAX_MATERIALS} in all")
    return MappingProxyType(checked)


def material_table(own: Mapping[str, Properties]) -> MaterialTable:
    """Return the program's materials, then a sketch's own."""
    if not own:
        return BUILT_IN
    return MaterialTable((*BUILT_IN, *(_own_material(name, values) for name, values in own.items())))


def _own_material(name: str, values: Properties) -> Material:
    base = BUILT_IN.materials[MATERIALS.index(values.get("like", OWN["like"].default))]
    title = name.replace("_", " ").capitalize()
    material = replace(base, name=name, title=title, tags="", is_mapped=True)
    if values.get("folder"):
        # Pictures may have a direction, such as courses of bricks.
        material = replace(material, texture=replace(base.texture, rotation=0.0, variations=()))
    if values.get("colour"):
        colour = rgb_from_hex(values["colour"])
        red, green, blue = (round(_PALE * 255 + (1 - _PALE) * part) for part in colour)
        material = replace(material, colour=colour, tint=(red, green, blue))
    return material


def with_materials(parameters: Mapping[str, Parameter], table: MaterialTable) -> Mapping[str, Parameter]:
    """Return parameters that can name any material of a table."""
    if table == BUILT_IN:
        return parameters
    return parameter_table(
        *(
            replace(each, choices=table.names) if each.choices == MATERIALS else each
            for each in parameters.values()
        )
    )


def check_materials_of_vectors(vectors: Mapping[str, FeatureTable], table: MaterialTable) -> None:
    """Raise InputError if a feature names a material that is not in a table."""
    for layer in vectors.values():
        for name, declared in LAYERS[layer.layer].parameters.items():
            if declared.choices != MATERIALS or layer.texts(name) <= {"", *table.names}:
                continue
            column = layer.columns[name]
            number = next(index for index, value in enumerate(column) if value not in ("", *table.names))
            expected = " or ".join(map(repr, table.names))
            raise InputError(
                f"{layer.layer} feature {layer.ids[number]}: {name} = {format_value(column[number])}: "
                f"expected {expected}"
            )


def picture_files(folder: str | Path, name: str) -> dict[str, Path]:
    """Return the pictures of a material in a folder by what they hold; raise InputError without an albedo."""
    where = f"[materials.{name}] folder = {format_value(str(folder))}"
    try:
        paths = sorted(path for path in Path(folder).iterdir() if path.suffix.lower() in _SUFFIXES)
    except OSError as error:
        raise InputError(f"{where}: expected a folder of pictures ({error.strerror})") from None
    found: dict[str, Path] = {}
    for path in paths:
        words = re.split(r"[^a-z]+", path.stem.lower().replace("base_color", "basecolor"))
        for kind, known in _WORDS.items():
            if any(word in known for word in words):
                if kind in found:
                    got = f"{found[kind].name}, {path.name}"
                    raise InputError(f"{where}: expected one picture of {kind}, got {got}")
                found[kind] = path
                break
    if "albedo" not in found:
        raise InputError(f"{where}: expected a picture named albedo, color or diffuse, PNG or JPEG")
    return found
