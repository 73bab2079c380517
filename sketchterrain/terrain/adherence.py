"""Adherence: how closely a terrain follows its sketch, measured on the terrain's own heights.

Areas and heights are measured by removing one layer's painted features and comparing heights; rivers by
walking down their centrelines. Everything is sampled at full detail, areas at the sketch's pixel centres.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.terrain.adherence_areas import AreaImages, SampledTerrain, measure_layer
from sketchterrain.terrain.adherence_rivers import measure_river_adherence

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from sketchterrain.terrain.adherence_areas import ShapeAdherence
    from sketchterrain.terrain.adherence_rivers import RiverAdherence
    from sketchterrain.terrain.terrain import Terrain

AREA_LAYERS = ("mountain", "hill", "dune", "forest", "lake", "river")
"""Layers whose painted areas are measured, in the order of the report."""


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
    """Ratio of reached to requested height of the measured mountains."""

    measured: int
    capped: int  # mountains too small for their label's height: the target is inradius · tan 70°
    least: float | None
    mean: float | None
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

    The area of a layer with heights (mountain, hill, dune) is where the height with that layer's painted
    features differs from the height without them by more than a quarter of its label's. Forests have no
    height: theirs is where the tree cover differs by more than a quarter of the label's density. Troughs
    between dune crests at most a wavelength apart count as dunes. Lakes and rivers are where water stands.
    Every pixel belongs to the nearest painted shape.
    """
    sampled = SampledTerrain.evaluate(terrain)
    measured = {
        name: measure_layer(sampled, name) for name in AREA_LAYERS if terrain.sketch.layers[name].any()
    }
    shapes = tuple(shape for layer_shapes, _ in measured.values() for shape in layer_shapes)
    return Adherence(
        layers={name: _summary(layer_shapes, images) for name, (layer_shapes, images) in measured.items()},
        peaks=_peaks(shapes),
        shapes=shapes,
        rivers=measure_river_adherence(terrain),
        images={name: images for name, (_, images) in measured.items()},
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
