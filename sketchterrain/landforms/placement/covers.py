"""Covers: forests and painted materials as signed distance fields."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import Float64Array
from sketchterrain.geometry.hashing import gaussian_filter
from sketchterrain.landforms.placement.feature_types import LAYER_CODES, Cover, ShapeField, even_wave
from sketchterrain.landforms.placement.shapes import EDGE_OVERHANG, Shape, label_shapes

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


# Standard deviation of the blur that rounds an outline at fidelity 0, pixels.
_BLUR = 4.0
# A blur is no wider than this share of the shape's greatest depth: small shapes keep their form.
_BLUR_SHARE = 0.5
_RAGGED = 0.4  # share of the overhang by which its end is nearer or farther
_RAGGED_WAVES = ((1.7, 0.5), (4.3, 0.3), (9.1, 0.2))  # along the sketch's longer side, and their shares
_GOLDEN = 1.618  # waves along columns over those along rows


def shape_field(sketch: Sketch, shape: Shape, *, margin: float) -> ShapeField:
    """Return the signed distance to a shape's border at pixel centres, with `margin` (m) around it.

    The border runs midway between painted and other pixels. It is rounded the more the lower the fidelity,
    and shifted to preserve the shape's area. A shape that touches the sketch's edge continues beyond it, to
    an uneven end.
    """
    height, width = sketch.height_px, sketch.width_px
    overhang = int(np.ceil((1.0 + _RAGGED) * EDGE_OVERHANG * max(height, width)))
    # Distances shrink by up to two pixels where the border is moved.
    rim = int(np.ceil(margin / sketch.pixel_size)) + 3
    north, south = overhang * (shape.rows.start == 0), overhang * (shape.rows.stop == height)
    west, east = overhang * (shape.columns.start == 0), overhang * (shape.columns.stop == width)
    mask = np.pad(shape.mask, ((north, south), (west, east)), mode="edge")
    mask &= _reached(mask.shape, (shape.rows.start - north, shape.columns.start - west), (height, width))
    mask = np.pad(mask, rim)
    inside = _rounded(signed_distance(mask), mask, (1.0 - sketch.fidelity) * _BLUR)
    pixel = sketch.pixel_size
    return ShapeField(
        west=(shape.columns.start - west - rim + 0.5) * pixel,
        south=(height - shape.rows.stop - south - rim + 0.5) * pixel,
        spacing=pixel,
        inside=np.ascontiguousarray(inside[::-1] * pixel, dtype=np.float32),
    )


def shore_positions(field: ShapeField, most: int = 4096) -> Float64Array:
    """Return positions (n, 2), m, of samples just outside a shape, about so many at most."""
    row, column = np.nonzero((field.inside <= 0.0) & (field.inside > -1.5 * field.spacing))
    thin = max(len(row) // most, 1)
    at = np.stack([column[::thin], row[::thin]], axis=-1) * field.spacing
    return np.asarray(at + np.array([field.west, field.south]))


def _reached(size: tuple[int, ...], first: tuple[int, int], sketch: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Return which pixels of an image, from a first one on, shapes reach that continue beyond a sketch."""
    longer = max(sketch)
    at = [np.arange(count) + start for count, start in zip(size, first, strict=True)]
    nearest = [np.clip(each, 0, count - 1) for each, count in zip(at, sketch, strict=True)]
    beyond = np.sqrt(np.add.outer(*((each - near) ** 2 for each, near in zip(at, nearest, strict=True))))
    along = np.add.outer(nearest[0], _GOLDEN * nearest[1]) / longer
    wave = sum(share * even_wave(count * along) for count, share in _RAGGED_WAVES)
    return np.asarray(beyond <= (1.0 + _RAGGED * wave) * (EDGE_OVERHANG * longer))


def signed_distance(mask: npt.NDArray[np.bool_]) -> Float64Array:
    """Return the distance of pixel centres from the border (px), positive inside."""
    within, beyond = ndimage.distance_transform_edt(mask), ndimage.distance_transform_edt(~mask)
    return np.asarray(np.where(mask, within - 0.5, 0.5 - beyond), dtype=np.float64)


def _rounded(distance: Float64Array, mask: npt.NDArray[np.bool_], blur: float) -> Float64Array:
    """Blur a distance field and shift it to preserve the number of pixels inside."""
    sigma = min(blur, _BLUR_SHARE * float(distance.max()))
    if sigma <= 0:
        return distance
    smooth = gaussian_filter(distance, sigma, axes=(0, 1))
    rank = mask.size - int(np.count_nonzero(mask))
    below, above = np.partition(smooth.ravel(), [rank - 1, rank])[[rank - 1, rank]]
    return np.asarray(smooth - 0.5 * (below + above))


# Width (px) of a cover's transition at fidelity 1 and at 0, as packed for the kernel.
_MARGIN = (1.0, 7.0)


def create_covers(sketch: Sketch) -> tuple[Cover, ...]:
    """Return the material layer's visible shapes, in reading order of their first pixels.

    Shapes of one layer do not overlap; where two borders meet, the later one is on top.
    """
    sharp, soft = _MARGIN
    margin = (soft + (sharp - soft) * sketch.fidelity) * sketch.pixel_size
    covers = []
    for shape in label_shapes("material", sketch.layers["material"]):
        properties = sketch.properties("material", shape.label)
        strength = float(properties["strength"])
        if strength <= 0:
            continue
        shape_distance = shape_field(sketch, shape, margin=margin)
        material = sketch.material_table.names.index(str(properties["material"]))
        name = LAYER_CODES["material"] << 48 | shape.id
        covers.append(Cover(name, shape.label, shape_distance, material, strength))
    return tuple(covers)
