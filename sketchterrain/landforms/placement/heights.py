"""Heights of mountains and hills by their width: real summits seldom rise higher than theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from sketchterrain.schema.layers import HEIGHT_LIMIT, LAYERS
from sketchterrain.schema.parameters import Properties

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

UNSET_HEIGHT = 0.7
"""Height of a label without one, in inradii: the median of real summits."""

_FREE_HEIGHT = 1.0  # inradii, up to which heights are built unchanged
_LOOSE = 0.8  # greatest fidelity at which heights saturate at their limit


class ShapeHeight(NamedTuple):
    """Height (m) of a painted shape: what its label asks for, and what is built."""

    asked: float
    built: float

    @property
    def is_limited(self) -> bool:
        """Whether the shape is too small for its height."""
        return self.built < 0.99 * self.asked


def shape_height(properties: Properties, inradius: float, fidelity: float) -> ShapeHeight:
    """Return the height of a shape by its label's properties; `inradius` is its largest circle's (m)."""
    asked = float(properties["height"]) or UNSET_HEIGHT * inradius
    return ShapeHeight(asked, built_height(asked, inradius, fidelity, float(properties["height_limit"])))


def unpainted_height(sketch: Sketch, layer: str, label: int = 1) -> float:
    """Return the height (m) of a label of mountains, hills or plateaus where nothing is painted."""
    declared = float(sketch.properties(layer, label)["height"])
    unset = LAYERS[layer].main.sentinel
    return unset.start if unset is not None and declared == unset.value else declared


def exactness(fidelity: float) -> float:
    """Return how strictly features obey their shapes: 0 up to a fidelity of 0.8, 1 at 1."""
    share = min(max((fidelity - _LOOSE) / (1.0 - _LOOSE), 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


def built_height(asked: float, inradius: float, fidelity: float, limit: float = HEIGHT_LIMIT) -> float:
    """Return the height (m) that is built for a shape.

    Parameters
    ----------
    asked : height of its label (m)
    inradius : radius of the largest circle within the shape (m)
    fidelity : 0 … 1; up to 0.8 heights above one inradius saturate smoothly towards the limit, above it less
        and less so; at 1 they stand as asked
    limit : greatest height in inradii at a fidelity up to 0.8
    """
    free = min(_FREE_HEIGHT, limit) * inradius
    excess, room = asked - free, limit * inradius - free
    if excess <= 0.0:
        return asked
    saturated = free + (excess * room / (excess + room) if room > 0.0 else 0.0)
    exact = exactness(fidelity)
    return asked if exact == 1.0 else saturated + exact * (asked - saturated)
