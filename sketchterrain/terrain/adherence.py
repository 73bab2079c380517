"""How far a terrain does what its sketch says, measured on the terrain's own heights.

Areas and heights are measured by leaving one layer's painted features out and looking at what is missing;
rivers by walking down their centrelines. All is sampled at full detail, areas at the sketch's pixel centres.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.terrain.adherence_areas import AreaImages, Sampled, measure_layer
from sketchterrain.terrain.adherence_rivers import measure_rivers

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from sketchterrain.terrain.adherence_areas import ShapeAdherence
    from sketchterrain.terrain.adherence_rivers import RiverAdherence
    from sketchterrain.terrain.terrain import Terrain

AREA_LAYERS = ("mountain", "hill", "dune", "forest", "lake", "river")
"""Layers whose painted areas are measured, in the order of the report."""


@dataclass(frozen=True)
class LayerSummary:
    """One layer's shapes in a few numbers.

    Attributes
    ----------
    shapes : int
        Painted shapes.
    measured : int
        Those at least six pixels wide, from which the other figures come.
    lost : int
        Shapes of which the terrain shows nothing, of any width.
    iou_mean, iou_median, iou_p10 : float or None
        Intersection over union of the painted and the risen area: mean, median, 10th percentile; None where
        nothing is measured.
    spill : float or None
        Area that rises beyond the measured shapes, over their painted area.
    """

    shapes: int
    measured: int
    lost: int
    iou_mean: float | None
    iou_median: float | None
    iou_p10: float | None
    spill: float | None


@dataclass(frozen=True)
class PeakSummary:
    """Reached over asked-for height of the measured mountains.

    Attributes
    ----------
    measured, capped : int
        Mountains at least six pixels wide, and how many of them are too small for the height that their label
        asks for: those are asked for inradius · tan 70°.
    least, mean, most : float or None
        Ratios.
    """

    measured: int
    capped: int
    least: float | None
    mean: float | None
    most: float | None


@dataclass(frozen=True, eq=False)
class Adherence:
    """What :func:`measure_adherence` found.

    Attributes
    ----------
    layers : mapping of str to LayerSummary
        Of each painted layer.
    peaks : PeakSummary
    shapes : tuple of ShapeAdherence
    rivers : tuple of RiverAdherence
    images : mapping of str to AreaImages
        For each painted layer what was painted and what the terrain shows, pixel by pixel.
    """

    layers: Mapping[str, LayerSummary]
    peaks: PeakSummary
    shapes: tuple[ShapeAdherence, ...]
    rivers: tuple[RiverAdherence, ...]
    images: Mapping[str, AreaImages]

    @property
    def lost(self) -> int:
        """Number of shapes of which the terrain shows nothing."""
        return sum(layer.lost for layer in self.layers.values())

    @property
    def mean_iou(self) -> float | None:
        """Mean intersection over union over all measured shapes of all layers."""
        return _mean(shape.iou for shape in self.shapes if shape.iou is not None)

    def as_dict(self) -> dict[str, Any]:
        """Return all but the images, ready for JSON; None where nothing was measured."""
        told = {
            "lost": self.lost,
            "mean_iou": self.mean_iou,
            "layers": {name: asdict(layer) for name, layer in self.layers.items()},
            "peaks": asdict(self.peaks),
            "shapes": [asdict(shape) for shape in self.shapes],
            "rivers": [asdict(river) for river in self.rivers],
        }
        return {key: _rounded(value) for key, value in told.items()}


def measure_adherence(terrain: Terrain) -> Adherence:
    """Measure how far a terrain does what its sketch says.

    An area of a layer with heights (mountain, hill, dune) is where the height with that layer's painted
    features differs from the height without them by more than a quarter of what its label asks for. Forests
    have no height: theirs is where the share of the ground that carries trees differs by more than a quarter
    of the label's. Between crests of dunes that are no more than a wavelength apart the troughs count as
    dunes. Lakes and rivers are where water stands. Ground belongs to the painted shape that is nearest.

    Parameters
    ----------
    terrain : Terrain
        Of any sketch.

    Returns
    -------
    Adherence
    """
    sampled = Sampled.of(terrain)
    found = {name: measure_layer(sampled, name) for name in AREA_LAYERS if terrain.sketch.layers[name].any()}
    shapes = tuple(shape for of_layer, _ in found.values() for shape in of_layer)
    return Adherence(
        layers={name: _summary(of_layer, images) for name, (of_layer, images) in found.items()},
        peaks=_peaks(shapes),
        shapes=shapes,
        rivers=measure_rivers(terrain),
        images={name: images for name, (_, images) in found.items()},
    )


def _summary(shapes: tuple[ShapeAdherence, ...], images: AreaImages) -> LayerSummary:
    measured = [shape for shape in shapes if shape.iou is not None]
    iou = [shape.iou for shape in measured if shape.iou is not None]
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
    mountains = [shape for shape in shapes if shape.layer == "mountain" and shape.iou is not None]
    ratios = [shape.reached / shape.asked for shape in mountains if shape.reached is not None and shape.asked]
    return PeakSummary(
        measured=len(mountains),
        capped=sum(shape.capped for shape in mountains),
        least=min(ratios, default=None),
        mean=_mean(ratios),
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
