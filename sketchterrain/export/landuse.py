"""Areas of land use as a vector layer, as entries of features.json and as shares of the samples of a map."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import shapely
from rasterio.features import rasterize
from rasterio.transform import Affine

from sketchterrain.document.layers import LAND_USES
from sketchterrain.document.sketch import Sketch
from sketchterrain.export.vectors import Origin, VectorLayer

_PARTS = 4  # of a sample, along each side, whose middles are inside an area or not
_TEXTS, _NUMBERS = ("use", "crop"), ("direction", "parcels", "density", "conifers")
FIELDS: Final = (
    "direction: degrees of rows, -1 along contours; parcels: m; density, conifers: shares; -1 by elevation"
)


def land_layer(sketch: Sketch, origin: Origin) -> VectorLayer:
    """Return the areas with their properties, their labels' included, the lowest one first."""
    layer = sketch.vectors["landuse"]
    fields: dict[str, npt.NDArray[Any]] = {
        "id": layer.ids,
        "label": layer.labels.astype(np.int32),
        **_properties(sketch),
    }
    shapes = shapely.transform(layer.shapes(), lambda at: at + origin)
    order = np.argsort(layer.ids, kind="stable")
    return VectorLayer(
        "landuse", "Polygon", shapes[order], {name: each[order] for name, each in fields.items()}
    )


def land_entries(sketch: Sketch) -> Iterator[dict[str, Any]]:
    """Yield the entries of areas in features.json: properties, and the border and holes (m)."""
    layer = sketch.vectors["landuse"]
    columns = {name: values.tolist() for name, values in _properties(sketch).items()}
    for index in np.argsort(layer.ids, kind="stable").tolist():
        rings = [layer.ring(ring).tolist() for ring in range(*layer.parts[index : index + 2])]
        own = {name: values[index] for name, values in columns.items()}
        yield {"id": int(layer.ids[index]), "type": "landuse", **own, "rings": rings}


def land_facts(sketch: Sketch) -> dict[str, Any]:
    """Return a report's entry for each use: the number of areas, and their size (ha)."""
    use, size = (
        np.array(sketch.vector_texts("landuse", "use")),
        shapely.area(sketch.vectors["landuse"].shapes()),
    )
    return {
        name: {"areas": int((use == name).sum()), "hectares": round(float(size[use == name].sum()) / 1e4, 2)}
        for name in LAND_USES
        if (use == name).any()
    }


def land_shares(
    sketch: Sketch, spacing: tuple[float, float], size: tuple[int, int]
) -> npt.NDArray[np.float32]:
    """Return the share of each use around samples (rows, columns) at vertices, row 0 north: (…, uses)."""
    use = [1 + LAND_USES.index(name) for name in sketch.vector_texts("landuse", "use")]
    shapes, (rows, columns), (east, north) = sketch.vectors["landuse"].shapes(), size, spacing
    order = np.argsort(sketch.vectors["landuse"].ids, kind="stable").tolist()
    fine = Affine(east / _PARTS, 0.0, -0.5 * east, 0.0, -north / _PARTS, (rows - 0.5) * north)
    found = rasterize(
        ((shapes[each], use[each]) for each in order),  # the last one is on top
        (_PARTS * rows, _PARTS * columns),
        transform=fine,
        dtype="uint8",
    ).reshape(rows, _PARTS, columns, _PARTS)
    shares = [
        (found == number).mean(axis=(1, 3), dtype=np.float32) for number in range(1, len(LAND_USES) + 1)
    ]
    return np.stack(shares, axis=-1)


def _properties(sketch: Sketch) -> dict[str, npt.NDArray[Any]]:
    texts = {name: np.array(sketch.vector_texts("landuse", name), object) for name in _TEXTS}
    return texts | {name: sketch.vector_values("landuse", name) for name in _NUMBERS}
