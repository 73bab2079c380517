"""`Sketch`: label layers, properties of their labels, and settings of the world, as a checked value."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Integral
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.document.drapes import DrapedLayer, check_drapes, moved_drapes
from sketchterrain.document.edits import MAX_EDITS, Edit
from sketchterrain.document.frame import check_frame
from sketchterrain.document.label_layers import (
    MAX_LABELS,
    MAX_SIDE,
    LabelImage,
    check_image,
    freeze_image,
    labels_in,
)
from sketchterrain.document.material_rules import RuleChange, check_rule_changes
from sketchterrain.document.own_materials import (
    check_materials_of_vectors,
    check_own_materials,
    material_table,
    with_materials,
)
from sketchterrain.document.rasters import RasterSource, check_rasters
from sketchterrain.errors import InputError, did_you_mean, format_value
from sketchterrain.features.table import FeatureTable, check_vectors
from sketchterrain.schema.layers import DENSITY, LANE_WIDTHS, LAYERS, PAINTED_LAYERS, Layer
from sketchterrain.schema.materials import MaterialTable
from sketchterrain.schema.parameters import (
    BASE,
    CLIMATE,
    COAST,
    FRAME,
    GEOLOGY,
    GROUND,
    LOOK,
    SKETCH,
    WEATHER,
    Parameter,
    Properties,
    check_items,
    check_values,
    defaults,
)

__all__ = ["DEFAULT_SIDE", "MAX_LABELS", "MAX_SIDE", "LabelImage", "Sketch", "labels_in"]

TABLES: Mapping[str, Mapping[str, Parameter]] = MappingProxyType(
    {
        "density": DENSITY,
        "ground": GROUND,
        "geology": GEOLOGY,
        "climate": CLIMATE,
        "coast": COAST,
        "weather": WEATHER,
        "frame": FRAME,
        "base": BASE,
    }
)
"""Tables of the file with one value per key."""

DEFAULT_SIDE = 512
"""Pixels along each side of a sketch without any layer image."""


@dataclass(frozen=True, eq=False)
class Sketch:
    """Painted label layers and settings.

    A sketch is immutable; values are checked when it is created, and `replace` returns a changed one. Image
    row 0 is the north edge: the centre of pixel (row, col) is at x = (col + 0.5)·s,
    y = (height_px − row − 0.5)·s metres, with s = `pixel_size`.

    Parameters
    ----------
    name
        Title.
    extent
        Metres along the longer side.
    seed
        0 to 2⁶³ − 1.
    fidelity
        0 (a loose guideline) to 1 (exactly where it was painted).
    density, ground, geology, climate, coast, weather, frame, base
        Settings by the names in `DENSITY`, `GROUND`, `GEOLOGY`, `CLIMATE`, `COAST`, `WEATHER`, `FRAME` and
        `BASE`; missing ones have defaults.
    layers
        Label images by the names in `PAINTED_LAYERS`: uint8, (height, width), 0 is empty. Missing layers are
        empty. The arrays of a sketch are read-only; a writeable array is copied.
    vectors
        Points, lines and areas by layer name; missing layers are empty.
    rasters
        Georeferenced grids and pictures by path; none is copied unless it is embedded.
    drapes
        Vectors and rasters that are shown on the terrain, from the lowest to the highest.
    labels
        Properties by (layer name, label); missing ones have defaults.
    materials
        Materials of the sketch's own: values by the names in `OWN`, by name.
    look
        Appearance of materials: values by the names in `LOOK`, by a material's name.
    edits
        Changes of generated features, applied in this order.
    material_rules
        Changes of the table of material rules.
    notes
        What was changed in reading it, a line each; not stored.

    Raises
    ------
    InputError
        If a value is not as declared, or a layer is no label image or differs in size from the others.
    """

    name: str = cast(str, SKETCH["name"].default)
    extent: float = cast(float, SKETCH["extent"].default)
    seed: int = cast(int, SKETCH["seed"].default)
    fidelity: float = cast(float, SKETCH["fidelity"].default)
    density: Mapping[str, float] = field(default_factory=dict)
    ground: Mapping[str, float] = field(default_factory=dict)
    geology: Mapping[str, Any] = field(default_factory=dict)
    climate: Mapping[str, float] = field(default_factory=dict)
    coast: Mapping[str, float] = field(default_factory=dict)
    weather: Mapping[str, float] = field(default_factory=dict)
    frame: Mapping[str, Any] = field(default_factory=dict)
    base: Mapping[str, float] = field(default_factory=dict)
    layers: Mapping[str, LabelImage] = field(default_factory=dict)
    vectors: Mapping[str, FeatureTable] = field(default_factory=dict)
    rasters: tuple[RasterSource, ...] = ()
    drapes: tuple[DrapedLayer, ...] = ()
    labels: Mapping[tuple[str, int], Properties] = field(default_factory=dict)
    materials: Mapping[str, Properties] = field(default_factory=dict)
    look: Mapping[str, Properties] = field(default_factory=dict)
    edits: tuple[Edit, ...] = ()
    material_rules: tuple[RuleChange, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        checked: dict[str, object] = {
            key: parameter.check(getattr(self, key)) for key, parameter in SKETCH.items()
        }
        for key, table in TABLES.items():
            given = check_values(getattr(self, key), table, f"[{key}]", f"{key}.")
            checked[key] = MappingProxyType(defaults(table) | given)
        check_frame(checked["frame"])  # type: ignore[arg-type]
        checked["materials"] = check_own_materials(self.materials)
        materials = material_table(self.materials)
        checked["layers"] = _check_layers(self.layers)
        checked["vectors"] = vectors = check_vectors(self.vectors)
        check_materials_of_vectors(vectors, materials)
        checked["rasters"] = check_rasters(self.rasters)
        checked["drapes"] = check_drapes(self.drapes)
        checked["labels"] = _check_labels(self.labels, materials)
        checked["look"] = _check_look(self.look, materials)
        checked["edits"] = check_items(Edit, self.edits, "edits", most=MAX_EDITS)
        checked["material_rules"] = check_rule_changes(self.material_rules, materials.names)
        for key, value in checked.items():
            object.__setattr__(self, key, value)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, with compressed layers; empty ones are omitted."""
        packed = {name: zlib.compress(image.data, 1) for name, image in self.layers.items() if image.any()}
        return vars(self) | {"layers": packed, "size_px": (self.height_px, self.width_px)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore fields, which were checked when the sketch was created."""
        size = state.pop("size_px")
        empty = freeze_image(np.zeros(size, dtype=np.uint8))
        layers = {
            name: freeze_image(np.frombuffer(zlib.decompress(packed), dtype=np.uint8).reshape(size))
            for name, packed in state["layers"].items()
        }
        state["layers"] = MappingProxyType({name: layers.get(name, empty) for name in PAINTED_LAYERS})
        for key, value in state.items():
            object.__setattr__(self, key, value)

    @property
    def width_px(self) -> int:
        """Pixels from west to east."""
        return int(next(iter(self.layers.values())).shape[1])

    @property
    def height_px(self) -> int:
        """Pixels from north to south."""
        return int(next(iter(self.layers.values())).shape[0])

    @property
    def pixel_size(self) -> float:
        """Metres along the side of a pixel."""
        return self.extent / max(self.width_px, self.height_px)

    @property
    def size(self) -> tuple[float, float]:
        """Metres (eastward, northward) that the sketch covers from the origin."""
        return self.width_px * self.pixel_size, self.height_px * self.pixel_size

    def properties(self, layer: str, label: int) -> Properties:
        """Return all properties of a label, with defaults for those that are not declared.

        Parameters
        ----------
        layer
            A name in `LAYERS`.
        label
            1 to 255; it need not be declared.

        Raises
        ------
        InputError
            If the layer or label is invalid.
        """
        table = _layer(layer).parameters
        declared = self.labels.get((layer, _check_label(layer, label)), {})
        return MappingProxyType(defaults(table) | dict(declared))

    def vector_values(self, layer: str, name: str, vectors: FeatureTable | None = None) -> Float64Array:
        """Return a number of each vector of a layer, (n,), by its name: its own, else its label's.

        `vectors`: others of that layer than all of the sketch's.
        """
        vectors = self.vectors[layer] if vectors is None else vectors
        of_labels, own = np.zeros(256), vectors.columns.get(name)
        for label in np.flatnonzero(vectors.label_counts).tolist():
            of_labels[label] = self.properties(layer, label)[name]
        values = of_labels[vectors.labels]
        return values if own is None else np.where(np.isnan(own), values, own)

    def vector_texts(self, layer: str, name: str, vectors: FeatureTable | None = None) -> list[str]:
        """Return a text of each vector of a layer, by its name, as `vector_values` does."""
        vectors = self.vectors[layer] if vectors is None else vectors
        labels, own = np.flatnonzero(vectors.label_counts).tolist(), vectors.columns.get(name)
        of_labels = {label: str(self.properties(layer, label)[name]) for label in labels}
        inherited = [of_labels[label] for label in vectors.labels.tolist()]
        if own is None:
            return inherited
        return [str(text) or other for text, other in zip(own, inherited, strict=True)]

    def vector_property(self, layer: str, name: str) -> list[Any]:
        """Return a value of each vector of a layer by its name, as `vector_values` does."""
        if LAYERS[layer].parameters[name].kind is str:
            return self.vector_texts(layer, name)
        return list(self.vector_values(layer, name).tolist())

    def vector_widths(self, layer: str) -> Float64Array:
        """Return the width of each vector of a layer, (n,), m; of ways without one, by their lanes."""
        widths = self.vector_values(layer, "width")
        if layer not in LANE_WIDTHS:
            return widths
        by_lanes = LANE_WIDTHS[layer] * self.vector_values(layer, "lanes")
        return np.where(widths == 0.0, by_lanes, widths)

    @property
    def material_table(self) -> MaterialTable:
        """The materials that the sketch can use."""
        return material_table(self.materials)

    @property
    def elevation_rasters(self) -> tuple[RasterSource, ...]:
        """The raster sources of real elevation beneath the sketch."""
        return tuple(source for source in self.rasters if source.role == "elevation")

    @property
    def looks(self) -> Mapping[str, Properties]:
        """Appearance of materials, its own ones included, by the names in `LOOK`."""
        own = {
            name: {key: values[key] for key in LOOK if key in values}
            for name, values in self.materials.items()
        }
        return own | {name: {**own.get(name, {}), **values} for name, values in self.look.items()}

    def replace(self, **changes: Any) -> Sketch:
        """Return a sketch with other values in the named fields, each replaced as a whole.

        With another extent vectors and edits of draped layers are scaled as paint is, unless they are among
        the changes.
        """
        extent = float(SKETCH["extent"].check(changes.get("extent", self.extent)))
        if (ratio := extent / self.extent) != 1.0:
            scaled = {
                "drapes": moved_drapes(self.drapes, lambda points: points * ratio),
                "vectors": {
                    name: dataclasses.replace(layer, vertices=layer.vertices * ratio)
                    for name, layer in self.vectors.items()
                },
            }
            changes = scaled | changes
        return dataclasses.replace(self, **changes)

    def with_edit(self, edit: Edit) -> Sketch:
        """Return a sketch with one more edit, without those that it supersedes.

        These are an earlier edit with the same target, and for a ``delete`` all others of the feature; an
        added feature then needs no ``delete`` itself.
        """
        if edit.action != "delete":
            others = [each for each in self.edits if each.target != edit.target]
            return self.replace(edits=(*others, edit))
        others = [each for each in self.edits if each.feature != edit.feature]
        was_added = any(each.action == "add" and each.feature == edit.feature for each in self.edits)
        return self.replace(edits=tuple(others) if was_added else (*others, edit))


def _layer(name: str) -> Layer:
    if name not in LAYERS:
        raise InputError(
            f"unknown layer {format_value(name)}: expected {', '.join(LAYERS)}"
            f"{did_you_mean(str(name), LAYERS)}"
        )
    return LAYERS[name]


def _check_look(look: Mapping[str, Mapping[str, object]], table: MaterialTable) -> Mapping[str, Properties]:
    checked = {}
    for name, values in look.items():
        if name not in table.names:
            near = did_you_mean(name, table.names)
            raise InputError(
                f"[look.{format_value(name)}]: expected a material, {', '.join(table.names)}{near}"
            )
        checked[name] = MappingProxyType(check_values(values, LOOK, f"[look.{name}]", f"look.{name}."))
    return MappingProxyType({name: checked[name] for name in table.names if name in checked})


def _check_label(layer: str, label: object) -> int:
    number = 0 if isinstance(label, bool) or not isinstance(label, Integral) else int(label)
    if not 1 <= number <= 255:
        raise InputError(f"[{layer}.{format_value(label)}]: expected a label from 1 to 255")
    return number


def _check_labels(
    labels: Mapping[tuple[str, int], Properties], materials: MaterialTable
) -> Mapping[tuple[str, int], Properties]:
    checked = {}
    order = {name: rank for rank, name in enumerate(LAYERS)}
    for (name, given), values in labels.items():
        layer = _layer(name)
        label = _check_label(name, given)
        where = f"{name}.{label}"
        checked[name, label] = MappingProxyType(
            check_values(values, with_materials(layer.parameters, materials), f"[{where}]", f"{where}.")
        )
    ordered = sorted(checked, key=lambda key: (order[key[0]], key[1]))
    return MappingProxyType({key: checked[key] for key in ordered})


def _check_layers(layers: Mapping[str, LabelImage]) -> Mapping[str, LabelImage]:
    drawn = next((name for name in layers if not _layer(name).is_painted), None)
    if drawn is not None:
        raise InputError(f"layer {drawn}: expected vectors, it has no label image")
    images = {name: check_image(name, image) for name, image in layers.items()}
    first = next(iter(images), None)
    shape = (DEFAULT_SIDE, DEFAULT_SIDE) if first is None else images[first].shape
    for name, image in images.items():
        if image.shape != shape:
            raise InputError(
                f"layer {name} is {image.shape[1]}×{image.shape[0]} px but layer {first} is "
                f"{shape[1]}×{shape[0]} px: expected one size"
            )
    if len(images) < len(PAINTED_LAYERS):
        empty = freeze_image(np.zeros(shape, dtype=np.uint8))
        images |= {name: empty for name in PAINTED_LAYERS if name not in images}
    return MappingProxyType({name: images[name] for name in PAINTED_LAYERS})


def sketch_notes(sketch: Sketch) -> list[str]:
    """Return notes on a sketch's images, and for each painted label without a table, maybe a mistake."""
    return [*sketch.notes] + [
        f"label {label} of {layer} is painted, but sketch.toml has no [{layer}.{label}]: defaults are used"
        for layer, image in sketch.layers.items()
        for label in labels_in(image)
        if (layer, label) not in sketch.labels
    ]
