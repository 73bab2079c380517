"""Painted areas against the areas that the terrain shows, and painted heights against those reached."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage
from skimage.morphology import skeletonize

from sketchterrain.features import FEATURE_TYPES, label_shapes
from sketchterrain.terrain.evaluation import MASKS, Evaluator
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.packing import support_radii
from sketchterrain.terrain.water import standing_water

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features import Shape
    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain.recipe import TerrainRecipe
    from sketchterrain.terrain.terrain import Terrain

    Image = npt.NDArray[np.float32]
    Flags = npt.NDArray[np.bool_]

LEAST_WIDTH = 6.0
"""Shapes narrower than so many pixels are counted, but left out of the figures of areas and heights."""

SHOWN = 0.25
"""Share of the asked-for height that the terrain must differ by to belong to a shape."""

_TAN_70 = math.tan(math.radians(70.0))


@dataclass(frozen=True)
class ShapeAdherence:
    """One painted shape and what became of it.

    Attributes
    ----------
    layer : str
    label, id, area : int
        As in :class:`~sketchterrain.features.Shape`: label, index of the first pixel, pixels.
    lost : bool
        Whether the terrain shows nothing of it.
    iou : float or None
        Intersection over union of the painted and the shown area; None for a shape less than six pixels wide.
    spill : int
        Pixels that the terrain shows beyond the shape.
    asked, reached : float or None
        Height asked for and the greatest one reached above the ground without the layer, m; None for layers
        without heights, and ``reached`` for a shape less than six pixels wide.
    capped : bool
        Whether the shape is too small for its label's height: inradius · tan 70° is asked for instead.
    """

    layer: str
    label: int
    id: int
    area: int
    lost: bool
    iou: float | None
    spill: int
    asked: float | None
    reached: float | None
    capped: bool


@dataclass(frozen=True, eq=False)
class AreaImages:
    """A layer on the sketch's pixels: what was painted, and what the terrain shows."""

    painted: Flags
    shown: Flags


@dataclass(frozen=True, eq=False)
class Sampled:
    """A terrain at the centres of its sketch's pixels, in reading order: positions, heights (m), masks."""

    terrain: Terrain
    evaluator: Evaluator
    x: npt.NDArray[np.int64]
    y: npt.NDArray[np.int64]
    height: npt.NDArray[np.float32]
    masks: npt.NDArray[np.float32]

    @classmethod
    def of(cls, terrain: Terrain) -> Sampled:
        """Evaluate a terrain at full detail."""
        x, y = (to_lattice(axis, terrain.extent).ravel() for axis in pixel_centres(terrain.sketch))
        evaluator = Evaluator(terrain.recipe, terrain.context)
        height, masks = evaluator.points(x, y, cell_size=0.0)
        return cls(terrain, evaluator, x, y, height.astype(np.float32), masks.astype(np.float32))


def measure_layer(sampled: Sampled, layer: str) -> tuple[tuple[ShapeAdherence, ...], AreaImages]:
    """Measure the shapes of one layer; see :func:`~sketchterrain.terrain.adherence.measure_adherence`."""
    terrain = sampled.terrain
    sketch = terrain.sketch
    shapes = label_shapes(layer, sketch.layers[layer])
    if layer not in FEATURE_TYPES:
        x, y = pixel_centres(sketch)
        # Water is there or not.
        wet = standing_water(terrain.recipe, layer, x, y, sampled.height.reshape(x.shape))
        return agreement(sketch, shapes, wet.astype(np.float32), np.ones(len(shapes)))
    effect = _effect(sampled, layer)
    if layer == "dune":
        effect = _crest_to_crest(sketch, effect)
    key = "density" if layer == "forest" else "height"
    asked = np.array([sketch.properties(layer, shape.label)[key] for shape in shapes])
    return agreement(sketch, shapes, effect, asked, has_height=layer != "forest")


def agreement(
    sketch: Sketch,
    shapes: tuple[Shape, ...],
    effect: Image,
    asked: npt.NDArray[np.float64],
    *,
    has_height: bool = False,
) -> tuple[tuple[ShapeAdherence, ...], AreaImages]:
    """Compare the shapes of one layer with the effect that the layer has on the terrain.

    Parameters
    ----------
    sketch : Sketch
    shapes : tuple of Shape
        All of the layer's shapes.
    effect : (height, width) float32
        How much the layer changes the terrain at each pixel.
    asked : (n,) float64
        The effect that each shape asks for.
    has_height : bool
        Whether the effect is a height: then it is measured too, and capped where a shape is too small for it.

    Returns
    -------
    tuple of ShapeAdherence, and the images they come from.
    """
    inradius = np.array([shape.depth.max() for shape in shapes])
    cap = inradius * sketch.pixel_size * _TAN_70 if has_height else np.full(len(shapes), np.inf)
    capped, asked = asked > cap, np.minimum(asked, cap)
    number = np.full(effect.shape, -1)
    for index, shape in enumerate(shapes):
        number[shape.pixels(shape.mask)] = index
    painted = number >= 0
    nearest = ndimage.distance_transform_edt(~painted, return_distances=False, return_indices=True)
    owner = number[tuple(nearest)]
    shown = effect > SHOWN * asked[owner]

    count = len(shapes)
    both = np.bincount(owner[shown & painted], minlength=count)
    spill = np.bincount(owner[shown & ~painted], minlength=count)
    most = ndimage.maximum(effect, owner, np.arange(count))
    result = []
    for index, shape in enumerate(shapes):
        wide = _width(shape) >= LEAST_WIDTH
        result.append(
            ShapeAdherence(
                layer=shape.layer,
                label=shape.label,
                id=shape.id,
                area=shape.area,
                lost=bool(both[index] + spill[index] == 0),
                iou=float(both[index] / (shape.area + spill[index])) if wide else None,
                spill=int(spill[index]),
                asked=float(asked[index]) if has_height else None,
                reached=float(most[index]) if has_height and wide else None,
                capped=bool(capped[index]),
            )
        )
    return tuple(result), AreaImages(painted, shown)


def _width(shape: Shape) -> float:
    """Width (px): twice the inradius; of a river, a stroke that is wider where arms meet, the mean width."""
    if shape.layer == "river":
        return shape.area / max(int(np.count_nonzero(skeletonize(shape.mask))), 1)
    return 2.0 * float(shape.depth.max())


def _crest_to_crest(sketch: Sketch, effect: Image) -> Image:
    """Fill the troughs between dunes: a field of dunes is one area, whose ground is bare in places."""
    labels = np.unique(sketch.layers["dune"])
    wavelength = max(float(sketch.properties("dune", int(label))["wavelength"]) for label in labels if label)
    size = 2 * math.ceil(wavelength / sketch.pixel_size / 2.0) + 1
    closed: Image = ndimage.grey_closing(effect, size=(size, size))
    return closed


def pixel_centres(sketch: Sketch) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return x and y (m) of all pixel centres, each (height, width); row 0 is north."""
    x = (np.arange(sketch.width_px) + 0.5) * sketch.pixel_size
    y = (sketch.height_px - np.arange(sketch.height_px) - 0.5) * sketch.pixel_size
    return tuple(np.broadcast_arrays(x[None, :], y[:, None]))  # type: ignore[return-value]


def _effect(sampled: Sampled, layer: str) -> Image:
    """How much a layer's painted features change the terrain at each pixel of the sketch."""
    terrain, sketch = sampled.terrain, sampled.terrain.sketch
    effect = np.zeros((sketch.height_px, sketch.width_px), np.float32)
    reached = _reached(sketch, terrain.recipe, layer)
    if not reached.any():
        return effect
    at = reached.ravel()
    # They keep their places, so that what is derived from all features stays the same.
    painted = terrain.recipe.painted
    kept = np.where(painted["type"] == FEATURE_TYPES.index(layer), 0.0, painted["strength"])
    bare = sampled.evaluator.with_strengths(kept)
    height, masks = bare.points(sampled.x[at], sampled.y[at], cell_size=0.0)
    if layer == "forest":
        forest = MASKS.index("forest")
        effect[reached] = sampled.masks[at, forest] - masks[:, forest]
    else:
        effect[reached] = sampled.height[at] - height
    return effect


def _reached(sketch: Sketch, recipe: TerrainRecipe, layer: str) -> Flags:
    """Pixels in the boxes around what the painted features of a type can reach."""
    features = recipe.painted[recipe.painted["type"] == FEATURE_TYPES.index(layer)]
    reach = features["radius"] * support_radii(recipe) / sketch.pixel_size + 1.0
    column = features["x"] / sketch.pixel_size
    row = sketch.height_px - features["y"] / sketch.pixel_size
    sides = np.stack([row - reach, row + reach, column - reach, column + reach], axis=-1)
    reached = np.zeros((sketch.height_px, sketch.width_px), dtype=np.bool_)
    for top, bottom, left, right in np.maximum(sides, 0.0).astype(np.int64):
        reached[top : bottom + 1, left : right + 1] = True
    return reached
