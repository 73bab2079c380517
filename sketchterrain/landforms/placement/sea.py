"""The sea: its level, and its painted coast as a signed distance field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Float64Array
from sketchterrain.document.label_layers import LabelImage
from sketchterrain.geometry.hashing import gaussian_filter
from sketchterrain.landforms.placement.covers import signed_distance
from sketchterrain.landforms.placement.feature_types import ShapeField
from sketchterrain.schema.parameters import COAST

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

_MAX_SAMPLES = 1024  # of the field along the sketch's longer side
_MAX_OVERHANG = 256  # samples that paint at the edge is continued by before distances are measured
_BLUR = (0.5, 4.0)  # samples, px: standard deviation of the blur at fidelity 1 and added at 0
_DEPTH_BLUR, _MAX_DEPTH_BLUR = 0.25, 24.0  # shelves, samples: the smaller one blurs borders of depths
_RAGGED = (3.0, 10.0)  # samples by which noise shifts the coast just below fidelity 1, and added at 0
_RAGGED_FROM = 0.2  # below fidelity 1 the first of them grows over this much
_WANDER = 1 / 8  # of the extent by which a coast wanders far beyond the sketch
_CLIFF_BEACHES, _MIN_REACH = 8.0, 150.0  # widths of the beach, m; the larger one applies


@dataclass(frozen=True, eq=False)
class Sea:
    """The sea of a sketch."""

    level: float  # m
    beach: float  # m: width of the beach
    shelf: float  # m from the coast to the greatest depth
    coast: ShapeField | None  # distance inside the painted sea; None: it is where ground is below the level
    depth: ShapeField | None  # greatest depth of the painted sea, m


def cliff_reach(beach: float) -> float:
    """Return the distance (m) inland up to which a painted coast may lower the ground."""
    return max(_CLIFF_BEACHES * beach, _MIN_REACH)


def raggedness(fidelity: float, spacing: float) -> float:
    """Return by how much (m) noise shifts a painted coast at most, for the distance (m) of its samples."""
    loose = 1.0 - fidelity
    return spacing * (min(loose / _RAGGED_FROM, 1.0) * _RAGGED[0] + loose * _RAGGED[1])


def wandering(extent: float) -> float:
    """Return by how much (m) noise shifts a painted coast far beyond the sketch, at most."""
    return _WANDER * extent


def sea_level(sketch: Sketch) -> float | None:
    """Return the level of the sea (m), None without a sea; a painted sea without a level is at 0."""
    level = float(sketch.coast["sea_level"])
    if level != COAST["sea_level"].default:
        return level
    return 0.0 if sketch.layers["sea"].any() else None


def create_sea(sketch: Sketch) -> Sea | None:
    """Return the sea of a sketch, None without one."""
    level = sea_level(sketch)
    if level is None:
        return None
    fields = _fields(sketch) if sketch.layers["sea"].any() else (None, None)
    return Sea(level, float(sketch.coast["beach"]), float(sketch.coast["shelf"]), *fields)


def _fields(sketch: Sketch) -> tuple[ShapeField, ShapeField]:
    """Return the signed distance to the painted coast, constant where that is of no effect, and the depth.

    The fields end at the sketch's edge: what they are there continues outward without end, where coasts
    wander.
    """
    image, factor = _reduced(sketch.layers["sea"])
    mask = image > 0
    spacing, wander = factor * sketch.pixel_size, wandering(sketch.extent)
    ragged = raggedness(sketch.fidelity, spacing)
    inland = cliff_reach(float(sketch.coast["beach"])) + ragged
    seaward = float(sketch.coast["shelf"]) + ragged
    overhang = min(int(np.ceil((max(inland, seaward) + wander) / spacing)) + 1, _MAX_OVERHANG)
    padded = np.pad(mask, overhang, mode="edge")
    away = np.full(padded.shape, np.inf) if padded.all() else signed_distance(padded) * spacing
    # Constant parts before the blur, so that an edit changes the field only near it.
    inland, seaward = inland + 4 * spacing, seaward + 4 * spacing
    distance = np.clip(away, -inland, seaward)
    sharp, loose = _BLUR
    smooth = gaussian_filter(distance, sharp + loose * (1.0 - sketch.fidelity) / factor, axes=(0, 1))
    inner = np.s_[overhang:-overhang, overhang:-overhang]
    rim = np.ones(mask.shape, np.bool_)
    rim[1:-1, 1:-1] = False
    beyond = np.clip(away[inner], -inland - wander, seaward + wander) - np.clip(away[inner], -inland, seaward)
    fields = smooth[inner] + np.where(rim, beyond, 0.0), _depths(sketch, image, seaward / spacing)
    coast, depth = (
        ShapeField(0.5 * spacing, 0.5 * spacing, spacing, np.ascontiguousarray(each[::-1], np.float32))
        for each in fields
    )
    return coast, depth


def _depths(sketch: Sketch, image: LabelImage, shelf: float) -> Float64Array:
    """Return the greatest depth (m) by the nearest label, with smooth transitions; `shelf` in samples."""
    depths = np.array([0.0, *(float(sketch.properties("sea", label)["depth"]) for label in range(1, 256))])[
        image
    ]
    present = np.unique(depths[image > 0])
    if len(present) < 2:
        return np.full(image.shape, present.max(initial=1.0))
    nearest = ndimage.distance_transform_edt(image == 0, return_distances=False, return_indices=True)
    sigma = min(max(_DEPTH_BLUR * shelf, 1.0), _MAX_DEPTH_BLUR)
    return gaussian_filter(depths[tuple(nearest)], sigma, axes=(0, 1))


def _reduced(image: LabelImage) -> tuple[LabelImage, int]:
    """Return an image of fewer pixels, from the south-west corner, and how many pixels each one joins.

    It is painted where most of a pixel is, by its greatest label.
    """
    height, width = image.shape
    factor = -(-max(height, width) // _MAX_SAMPLES)
    if factor == 1:
        return image, 1
    whole = np.pad(image, ((-height % factor, 0), (0, -width % factor)), mode="edge")
    blocks = whole.reshape(whole.shape[0] // factor, factor, -1, factor)
    return np.where((blocks > 0).mean(axis=(1, 3)) >= 0.5, blocks.max(axis=(1, 3)), 0).astype(
        np.uint8
    ), factor
