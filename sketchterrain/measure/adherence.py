"""Adherence: how closely a terrain follows its sketch, measured on the terrain's own heights.

Areas and heights are measured by removing one layer's painted features and comparing heights, those of
mountains and hills on the same network of rivers and valleys; rivers by walking down their centrelines.
Everything is sampled at full detail, areas at the sketch's pixel centres.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage
from skimage.morphology import skeletonize

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, LatticeArray
from sketchterrain.generation.building import relief_without
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.landforms.hydrology.vector_layout import vectors_painted
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES, TAN_70
from sketchterrain.landforms.placement.heights import ShapeHeight, shape_height
from sketchterrain.landforms.placement.shapes import Shape, label_shapes
from sketchterrain.landuse.areas import NO_LAND_USE
from sketchterrain.measure.adherence_rivers import RiverAdherence, measure_river_adherence, standing_water
from sketchterrain.schema.layers import DRAW_ORDER, LAYERS, layer_of
from sketchterrain.stages.runner import Runner
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.layer import MASKS, TerrainLayer
from sketchterrain.terrain.layers.pads import PadsLayer
from sketchterrain.terrain.layers.points import support_radii
from sketchterrain.terrain.layers.roads import RoadsLayer
from sketchterrain.terrain.recipe import TerrainRecipe

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

MIN_WIDTH = 6.0
"""Minimum width (px) of a shape for its area and height to be measured; narrower ones are only counted."""

EFFECT_SHARE = 0.25
"""Share of the built height by which the terrain must differ for a pixel to count as affected."""

_LEAST_RISE = 1.0  # m
_ELEVATION_SHARE = 0.03  # by which a summit that its shape is too narrow for stays below its elevation

AREA_LAYERS = tuple(name for name in DRAW_ORDER if LAYERS[name].kind != "cover")
"""Layers whose painted areas are measured, in the order of the report."""


@dataclass(frozen=True)
class ShapeAdherence:
    """One painted shape and its effect on the terrain."""

    layer: str
    label: int
    id: int  # index of the first pixel, as in `Shape`
    area: int  # px
    lost: bool  # no visible effect on the terrain
    iou: float | None  # of the painted area and the area of effect; None below six pixels' width
    spill: int  # px affected beyond the shape
    asked: float | None  # height of its label, m; None for layers without heights
    built: float | None  # height that is aimed at, m: less where the shape is too narrow for its label's
    # Greatest height (m) above the terrain without the layer, or of the terrain where the label asks for an
    # elevation; None also if too narrow.
    reached: float | None
    limited: bool  # too narrow for the height of its label


@dataclass(frozen=True, eq=False)
class AreaImages:
    """A layer on the sketch's pixels: the painted area and the area of effect."""

    painted: BoolArray
    affected: BoolArray  # where the layer changes the terrain


@dataclass(frozen=True, eq=False)
class SampledTerrain:
    """A terrain at its sketch's pixel centres in reading order: positions, heights (m), masks."""

    terrain: Terrain
    sketch: Sketch  # its vectors are painted
    x: LatticeArray
    y: LatticeArray
    height: Float32Array
    masks: Float32Array

    @classmethod
    def evaluate(cls, terrain: Terrain) -> SampledTerrain:
        """Evaluate a terrain at full detail, without roads, pads and land use, which hide what is painted."""
        names = terrain.recipe.materials.names
        built = LandUseLayer(names, NO_LAND_USE), PadsLayer(names, ()), RoadsLayer(names, ())
        bare = terrain.recipe.with_layers(built)
        terrain, _ = terrain.updated(terrain.sketch, bare)
        x, y = (to_lattice(axis, terrain.extent).ravel() for axis in pixel_centres(terrain.sketch))
        height, masks = terrain.evaluator.points(x, y, cell_size=0.0)
        drawn = terrain.sketch.replace(layers=vectors_painted(terrain.sketch, Runner()))
        return cls(terrain, drawn, x, y, height.astype(np.float32), masks.astype(np.float32))


def measure_layer(sampled: SampledTerrain, layer: str) -> tuple[tuple[ShapeAdherence, ...], AreaImages]:
    """Measure the shapes of one layer; see :func:`~sketchterrain.measure.adherence.measure_adherence`."""
    terrain, sketch = sampled.terrain, sampled.sketch
    shapes = label_shapes(layer, sketch.layers[layer])
    declared = LAYERS[layer]
    if declared.is_water:
        x, y = pixel_centres(sketch)
        wet = standing_water(terrain.recipe, layer, x, y, sampled.height.reshape(x.shape))
        return agreement(shapes, wet.astype(np.float32), np.ones(len(shapes)))
    effect = _effect(sampled, layer)
    if "wavelength" in declared.parameters:
        effect = _crest_to_crest(sketch, layer, effect)
    if declared.is_share:
        requested = [sketch.properties(layer, shape.label)[declared.main.name] for shape in shapes]
        return agreement(shapes, effect, np.array(requested))
    heights = [_height(sketch, shape) for shape in shapes]
    strengths = np.array([each.built for each in heights])
    elevations = [number for number, shape in enumerate(shapes) if _is_elevation(sketch, shape)]
    for number in elevations:
        strengths[number] = max(float(_inside(shapes[number], effect).max()), _LEAST_RISE)
    found, images = agreement(shapes, effect, strengths, heights)
    total, result = sampled.height.reshape(effect.shape), list(found)
    for number in elevations:
        summit = float(_inside(shapes[number], total).max())
        asked = heights[number].asked
        limited = summit < (1.0 - _ELEVATION_SHARE) * asked
        result[number] = replace(found[number], built=asked, reached=summit, limited=limited)
    return tuple(result), images


def _is_elevation(sketch: Sketch, shape: Shape) -> bool:
    """Return whether a shape's height is an elevation: it rises from real ones."""
    if LAYERS[shape.layer].kind != "summits" or not sketch.elevation_rasters:
        return False
    return bool(sketch.properties(shape.layer, shape.label)["reach"] == "absolute")


def _inside(shape: Shape, values: Float32Array) -> Float32Array:
    return np.asarray(values[shape.pixels(shape.mask)])


def _height(sketch: Sketch, shape: Shape) -> ShapeHeight:
    """Return the height (m) that a shape's label asks for, and the one that is built."""
    properties = sketch.properties(shape.layer, shape.label)
    inradius = float(shape.depth.max()) * sketch.pixel_size
    if LAYERS[shape.layer].kind == "summits":
        return shape_height(properties, inradius, sketch.fidelity)
    asked = float(properties[LAYERS[shape.layer].main.name])
    return ShapeHeight(asked, min(asked, inradius * TAN_70))


def agreement(
    shapes: tuple[Shape, ...],
    effect: Float32Array,
    strengths: Float64Array,
    heights: Sequence[ShapeHeight] | None = None,
) -> tuple[tuple[ShapeAdherence, ...], AreaImages]:
    """Compare the ``effect`` (height, width) of a layer with the ``strengths`` (n,) of its shapes.

    Both are heights (m) if the ``heights`` of the shapes are given, to be reported with the greatest effect.
    """
    number = np.full(effect.shape, -1)
    for index, shape in enumerate(shapes):
        number[shape.pixels(shape.mask)] = index
    painted = number >= 0
    nearest = ndimage.distance_transform_edt(~painted, return_distances=False, return_indices=True)
    owner = number[tuple(nearest)]
    affected = effect > EFFECT_SHARE * strengths[owner]

    count = len(shapes)
    both = np.bincount(owner[affected & painted], minlength=count)
    spill = np.bincount(owner[affected & ~painted], minlength=count)
    most = ndimage.maximum(effect, owner, np.arange(count))
    result = []
    for index, shape in enumerate(shapes):
        wide = _width(shape) >= MIN_WIDTH
        result.append(
            ShapeAdherence(
                layer=shape.layer,
                label=shape.label,
                id=shape.id,
                area=shape.area,
                lost=bool(both[index] + spill[index] == 0),
                iou=float(both[index] / (shape.area + spill[index])) if wide else None,
                spill=int(spill[index]),
                asked=None if heights is None else heights[index].asked,
                built=None if heights is None else heights[index].built,
                limited=heights is not None and heights[index].is_limited,
                reached=None if heights is None or not wide else float(most[index]),
            )
        )
    return tuple(result), AreaImages(painted, affected)


def _width(shape: Shape) -> float:
    """Return the width (px): twice the inradius.

    For a river, whose inradius grows at confluences, the mean width.
    """
    if LAYERS[shape.layer].kind == "course":
        return shape.area / max(int(np.count_nonzero(skeletonize(shape.mask))), 1)
    return 2.0 * float(shape.depth.max())


def _crest_to_crest(sketch: Sketch, layer: str, effect: Float32Array) -> Float32Array:
    """Fill the troughs between dunes: a dune field is one area, partly bare."""
    labels = np.unique(sketch.layers[layer])
    wavelength = max(float(sketch.properties(layer, int(label))["wavelength"]) for label in labels if label)
    size = 2 * math.ceil(wavelength / sketch.pixel_size / 2.0) + 1
    closed: Float32Array = ndimage.grey_closing(effect, size=(size, size))
    return closed


def pixel_centres(sketch: Sketch) -> tuple[Float64Array, Float64Array]:
    """Return x and y (m) of all pixel centres, each (height, width); row 0 is north."""
    x = (np.arange(sketch.width_px) + 0.5) * sketch.pixel_size
    y = (sketch.height_px - np.arange(sketch.height_px) - 0.5) * sketch.pixel_size
    return tuple(np.broadcast_arrays(x[None, :], y[:, None]))  # type: ignore[return-value]


def _effect(sampled: SampledTerrain, layer: str) -> Float32Array:
    """Return how much a layer's painted features change the terrain at each pixel of the sketch."""
    terrain, sketch = sampled.terrain, sampled.terrain.sketch
    effect = np.zeros((sketch.height_px, sketch.width_px), np.float32)
    is_points = LAYERS[layer].kind == "patches"
    inside = _support(sketch, terrain.recipe, layer) if is_points else np.ones(effect.shape, np.bool_)
    if not inside.any():
        return effect
    at = inside.ravel()
    without, _ = sampled.terrain.evaluator.updated(terrain.recipe.with_layers(_without(terrain, layer)))
    height, masks = without.points(sampled.x[at], sampled.y[at], cell_size=0.0)
    if LAYERS[layer].is_share:
        mask = MASKS.index(layer)
        effect[inside] = sampled.masks[at, mask] - masks[:, mask]
    else:
        change = sampled.height[at] - height
        effect[inside] = np.abs(change) if LAYERS[layer].kind == "landform" else change
    return effect


def _without(terrain: Terrain, layer: str) -> list[TerrainLayer]:
    """Return the changed layers of the terrain without a layer's painted features."""
    kind = LAYERS[layer].kind
    if kind == "summits":
        return [relief_without(terrain.sketch, layer, terrain.memory)]
    if kind == "patches":
        # Zero strength, not removal: everything derived from the set of features stays the same.
        painted = terrain.recipe.points.painted.copy()
        painted["strength"][painted["type"] == FEATURE_TYPES.index(layer)] = 0.0
        return [replace(terrain.recipe.points, painted=painted)]
    changed: list[TerrainLayer] = []
    for each in terrain.recipe.layers:
        parts = (part.name for part in fields(each) if part.metadata.get("items"))
        shapes = {name: items for name in parts if isinstance(items := getattr(each, name), tuple)}
        for name, items in shapes.items():
            left = tuple(item for item in items if layer_of(getattr(item, "id", 0)) != layer)
            changed += [replace(each, **{name: left})] if len(left) < len(items) else []
    return changed


def _support(sketch: Sketch, recipe: TerrainRecipe, layer: str) -> BoolArray:
    """Return the pixels inside the bounding boxes of the supports of a type's painted features."""
    painted = recipe.points.painted
    features = painted[painted["type"] == FEATURE_TYPES.index(layer)]
    support = features["radius"] * support_radii(recipe.world.fidelity) / sketch.pixel_size + 1.0
    column = features["x"] / sketch.pixel_size
    row = sketch.height_px - features["y"] / sketch.pixel_size
    sides = np.stack([row - support, row + support, column - support, column + support], axis=-1)
    inside = np.zeros((sketch.height_px, sketch.width_px), dtype=np.bool_)
    for top, bottom, left, right in np.maximum(sides, 0.0).astype(np.int64):
        inside[top : bottom + 1, left : right + 1] = True
    return inside


@dataclass(frozen=True)
class LayerSummary:
    """Statistics over one layer's shapes; None where no shape is wide enough to be measured."""

    shapes: int
    measured: int  # shapes at least six pixels wide, from which the other figures come
    lost: int  # shapes of any width with no visible effect on the terrain
    # Intersection over union of the painted area and the area of effect.
    iou_mean: float | None
    iou_median: float | None
    iou_p10: float | None
    spill: float | None  # area of effect beyond the measured shapes, over their painted area


@dataclass(frozen=True)
class PeakSummary:
    """Ratio of reached to built height of the measured mountains and hills."""

    measured: int
    limited: int  # too narrow for their labels' heights
    least: float | None
    mean: float | None
    median: float | None
    most: float | None


@dataclass(frozen=True, eq=False)
class Adherence:
    """Result of :func:`measure_adherence`: by layer, by shape, by river, and pixel by pixel."""

    layers: Mapping[str, LayerSummary]  # painted ones
    peaks: PeakSummary
    shapes: tuple[ShapeAdherence, ...]
    rivers: tuple[RiverAdherence, ...]
    images: Mapping[str, AreaImages]

    @property
    def lost(self) -> int:
        """Number of shapes with no visible effect on the terrain."""
        return sum(layer.lost for layer in self.layers.values())

    @property
    def mean_iou(self) -> float | None:
        """Mean intersection over union over all measured shapes of all layers."""
        return _mean(shape.iou for shape in self.shapes if shape.iou is not None)

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the images, JSON-serialisable; None where nothing was measured."""
        report = {
            "lost": self.lost,
            "mean_iou": self.mean_iou,
            "layers": {name: asdict(layer) for name, layer in self.layers.items()},
            "peaks": asdict(self.peaks),
            "shapes": [asdict(shape) for shape in self.shapes],
            "rivers": [asdict(river) for river in self.rivers],
        }
        return {key: _rounded(value) for key, value in report.items()}


def measure_adherence(terrain: Terrain) -> Adherence:
    """Measure how closely a terrain follows its sketch.

    The area of a layer with heights (mountain, hill, dune, plateau) is where the height with that layer's
    painted shapes differs from the height without them by more than a quarter of the height that is built for
    them. Mountains and hills are removed on the same drainage network. Forests have no height: theirs is
    where the tree cover differs by more than a quarter of the label's density. Troughs between dune crests at
    most a wavelength apart count as dunes. Lakes and rivers are standing water; vectors are measured as if
    they were painted, and lines also by their distance. Every pixel belongs to the nearest painted shape.
    """
    sampled = SampledTerrain.evaluate(terrain)
    measured = {
        name: measure_layer(sampled, name) for name in AREA_LAYERS if sampled.sketch.layers[name].any()
    }
    shapes = tuple(shape for layer_shapes, _ in measured.values() for shape in layer_shapes)
    return Adherence(
        layers={name: _summary(layer_shapes) for name, (layer_shapes, _) in measured.items()},
        peaks=_peaks(shapes),
        shapes=shapes,
        rivers=measure_river_adherence(terrain),
        images={name: images for name, (_, images) in measured.items()},
    )


def _summary(shapes: tuple[ShapeAdherence, ...]) -> LayerSummary:
    measured = [shape for shape in shapes if shape.iou is not None]
    iou = [shape.iou for shape in shapes if shape.iou is not None]
    painted = sum(shape.area for shape in measured)
    return LayerSummary(
        shapes=len(shapes),
        measured=len(measured),
        lost=sum(shape.lost for shape in shapes),
        iou_mean=_mean(iou),
        iou_median=float(np.median(iou)) if iou else None,
        iou_p10=float(np.percentile(iou, 10)) if iou else None,
        spill=sum(shape.spill for shape in measured) / painted if painted else None,
    )


def _peaks(shapes: Iterable[ShapeAdherence]) -> PeakSummary:
    measured = [shape for shape in shapes if shape.iou is not None]
    summits = [shape for shape in measured if LAYERS[shape.layer].kind == "summits"]
    ratios = [shape.reached / shape.built for shape in summits if shape.reached is not None and shape.built]
    return PeakSummary(
        measured=len(summits),
        limited=sum(shape.limited for shape in summits),
        least=min(ratios, default=None),
        mean=_mean(ratios),
        median=float(np.median(ratios)) if ratios else None,
        most=max(ratios, default=None),
    )


def _mean(values: Iterable[float]) -> float | None:
    known = list(values)
    return float(np.mean(known)) if known else None


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_rounded(inner) for inner in value]
    return round(value, 4) if isinstance(value, float) else value
