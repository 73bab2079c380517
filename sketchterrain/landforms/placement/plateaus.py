"""Plateaus: tablelands over painted shapes, with the widths of their cliffs and of their talus."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import Float64Array
from sketchterrain.geometry.hashing import rounded
from sketchterrain.io.resources import kernel_constants
from sketchterrain.landforms.placement.covers import shape_field, shore_positions
from sketchterrain.landforms.placement.feature_types import (
    LAYER_CODES,
    TAN_70,
    VISIBLE_SHARE,
    GroundHeight,
    ShapeField,
    cubic,
    even_wave,
)
from sketchterrain.landforms.placement.shapes import Shape, label_shapes
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

_UNEVEN, _UNEVEN_RATE, _NOISE_START, _INVERSE_NOISE_RANGE, _INVERSE_FINE_RANGE = kernel_constants(
    *("layers/plateaus.clh", "UNEVEN", "UNEVEN_RATE"),
    *("NOISE_START", "INVERSE_NOISE_RANGE", "INVERSE_FINE_RANGE"),
)
CLIFF_NOISE: Final = 0.16
"""How far noise moves a cliff, over the wavelength of its widest waves."""
CLIFF_GAIN: Final = 0.45
"""Amplitude ratio of its octaves, those of gullies: slightly less than their wavelengths'."""
NOISE_REACH: Final = 1.3
"""Greatest share of an octave's amplitude."""
_OCTAVES = 9
_LOOSEST, _LOOSENING = 1.5, 3.9  # share of wide waves at a low fidelity; how fast it falls towards fidelity 1
_TALUS_SLOPE = 0.66  # just below the cliff: the angle of repose
_GENTLE, _STEEP = 0.8, 2.9  # mean slopes of cliffs without layers at cliffness 0 and 1
_LEDGE_RUN = 0.75  # share by which ledges widen a cliff of full strata
_LAYERS = 8.0  # in the height, about
_INSET = 0.7  # of the greatest depth of a shape, at most: from its border to the edge of its top
_SPARE = 0.5  # of the cliff's width, by which it may start farther out for coarse cells
_BORDER_POINTS = 2048
_HALVINGS = 40
_CANYON = 0.12  # half the width of a canyon's floor beside its river, over the plateau's height


_NO_FIELD = ShapeField(0.0, 0.0, 1.0, np.zeros((1, 1), np.float32))


@dataclass(frozen=True, eq=False)
class Plateau:
    """A mesa, butte or tableland."""

    id: int  # stable: layer code and a pixel of the shape
    label: int  # in the plateau layer
    shape: ShapeField
    ground: float  # elevation around, m
    top: float  # elevation that the cliff rises to where the ground is at that, m
    height: float  # asked for, m
    cliffness: float  # 0 … 1
    strata: float  # 0 … 1
    foot: float  # share of the height that its talus takes
    border: float  # share of the height that the painted border has
    layer_thickness: float  # of rock, m

    @property
    def talus_width(self) -> float:
        """Width of the talus (m), which leaves the plain flat and steepens as a parabola."""
        return 2.0 * self.foot * self.height / _TALUS_SLOPE

    @property
    def cliff_width(self) -> float:
        """Width of the cliff, m."""
        slope = (_GENTLE + (_STEEP - _GENTLE) * self.cliffness) / (1.0 + _LEDGE_RUN * self.strata)
        return (1.0 - self.foot) * self.height / slope

    @property
    def cliff_start(self) -> float:
        """Distance (m) of the foot of the cliff inside the painted border."""
        if self.foot > self.border:
            return self.talus_width * (1.0 - math.sqrt(self.border / self.foot))
        return -self.cliff_width * (self.border - self.foot) / (1.0 - self.foot)


def layer_phase(layers: Float64Array) -> Float64Array:
    """Return the number of rock layers up to a height over their thickness; whole at the top of each."""
    return np.asarray(layers + _UNEVEN * even_wave(layers * _UNEVEN_RATE))


def cliff_looseness(fidelity: float) -> float:
    """Return the share of the wide waves in the noise that moves cliffs."""
    return min(1.0 - _LOOSENING * (fidelity - 0.8), _LOOSEST)


def octave_share(waves: npt.ArrayLike, depth: float, fidelity: float) -> tuple[Float64Array, Float64Array]:
    """Return the share of octaves in a cliff's noise, and how much of an alcove each wave is, 0 … 1.

    ``waves`` is 1 / wavelength (1/m), ``depth`` the greatest distance (m) inside the plateau's border.
    """
    ratio = depth * np.asarray(waves)
    share = 1 - cubic(np.maximum(ratio - _NOISE_START, 0) * _INVERSE_NOISE_RANGE)
    fine = 1 - cubic(np.maximum(ratio - 1, 0) * _INVERSE_FINE_RANGE)
    loose = cliff_looseness(fidelity)
    return np.asarray(share * (loose + (1 - loose) * fine)), np.asarray(fine)


def noise_limit(extent: float, fidelity: float, depth: float) -> float:
    """Return how far (m) noise may move a cliff, half of its bound; ``depth`` as in `octave_share`."""
    octave = np.arange(_OCTAVES)
    share, _ = octave_share(2.0**octave * 8 / extent, depth, fidelity)
    return float(0.5 * NOISE_REACH * CLIFF_NOISE * extent / 8 * np.sum(CLIFF_GAIN**octave * share))


_READ: Final = ("layers.plateau", "layers.river", "labels.plateau", "extent", "size", "fidelity")


def create_plateaus(sketch: Sketch, ground: GroundHeight, run: Runner | None = None) -> tuple[Plateau, ...]:
    """Return the plateaus of a sketch, in the order of their ids.

    A higher plateau inside another one stands on it. A painted river cuts a canyon down to the ground. Tops
    are those of rock layers, so that neighbours of similar heights are level.
    """
    run = Runner() if run is None else run
    outlines = run(_outlines, part_of(sketch, *_READ))
    if not outlines:
        return ()
    at = np.concatenate([border for _, border in outlines])
    heights = np.asarray(ground(at[:, 0].copy(), at[:, 1].copy()), dtype=np.float64)
    ends = np.cumsum([len(border) for _, border in outlines])
    found = []
    for (plateau, border), end in zip(outlines, ends, strict=True):
        around = float(np.median(heights[end - len(border) : end]))
        top = layer_top(around + plateau.height, plateau.layer_thickness)
        found.append(replace(plateau, ground=around, top=top))
    return tuple(found)


def _outlines(sketch: Sketch) -> list[tuple[Plateau, Float64Array]]:
    """Return the plateaus on ground at 0, and positions (n, 2) along their borders, m."""
    image, river = sketch.layers["plateau"], sketch.layers["river"]
    if not image.any():
        return []
    away = ndimage.distance_transform_edt(river == 0) * sketch.pixel_size if river.any() else np.inf
    labels = [int(label) for label in np.unique(image) if label]
    heights = {label: float(sketch.properties("plateau", label)["height"]) for label in labels}
    found = []
    for label, height in heights.items():
        higher = [other for other, own in heights.items() if (own, other) >= (height, label)]
        mask = np.isin(image, higher) & (away > _CANYON * height)
        shapes = label_shapes("plateau", np.where(mask, np.uint8(label), np.uint8(0)))
        found += [
            _outline(sketch, shape)
            for shape in shapes
            if (image[shape.rows, shape.columns][shape.mask] == label).any()
        ]
    return sorted(found, key=lambda each: each[0].id)


def _outline(sketch: Sketch, shape: Shape) -> tuple[Plateau, Float64Array]:
    properties = sketch.properties("plateau", shape.label)
    height, depth = float(properties["height"]), float(shape.depth.max()) * sketch.pixel_size
    asked = min(height, depth * TAN_70)
    plateau = Plateau(
        id=LAYER_CODES["plateau"] << 48 | shape.label << 40 | shape.id,
        label=shape.label,
        shape=_NO_FIELD,
        ground=0.0,
        top=0.0,
        height=asked,
        cliffness=float(properties["cliffness"]),
        strata=float(properties["strata"]),
        foot=float(properties["foot"]),
        border=VISIBLE_SHARE,
        layer_thickness=2.0 ** round(float(np.log2(height / _LAYERS))),
    )
    # Small shapes are lower, so that their top has room; their border is at a quarter of what was asked for.
    for share in np.linspace(1.0, VISIBLE_SHARE, 64):
        plateau = replace(plateau, height=float(share) * asked, border=VISIBLE_SHARE / float(share))
        if plateau.cliff_start + plateau.cliff_width <= _INSET * depth:
            break
    margin = plateau.talus_width - plateau.cliff_start + noise_limit(sketch.extent, sketch.fidelity, depth)
    field = shape_field(sketch, shape, margin=margin + _SPARE * plateau.cliff_width)
    return replace(plateau, shape=field), shore_positions(field, _BORDER_POINTS)


def layer_top(elevation: float, thickness: float) -> float:
    """Return the top of a rock layer nearest to an elevation, m."""
    phase = round(float(layer_phase(np.array(elevation / thickness))))
    low, high = (elevation / thickness - 2.0, elevation / thickness + 2.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if layer_phase(np.array(middle)) < phase else (low, middle)
    return float(rounded(thickness * high))
