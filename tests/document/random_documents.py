"""Random documents: sketches with every kind of setting, vectors, a frame and raster sources."""

from hashlib import sha256
from pathlib import Path

import numpy as np

from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.rasters import RASTER, RasterSource
from sketchterrain.document.sketch import Sketch
from sketchterrain.features.table import (
    AREA,
    KINDS,
    LINE,
    POINT,
    Feature,
    FeatureTable,
    vector_parameters,
)
from sketchterrain.schema.layers import LAYERS, VECTOR_LAYERS
from tests.terrain.sketch_edits import CHANGES, SETTINGS, State, random_sketch

Rng = np.random.Generator

_PLACED = ("move", "resize", "strength", "delete", "lock", "undo", "withdraw", "width ")  # of features
_CHANGES = [name for name in CHANGES if name in SETTINGS or not name.startswith(_PLACED)]
_LETTERS = "abz AZ09_-.,;:'\"\\/#=[]{}%ßéÅıİ中国日本語ไทยשלום🏔️\u0301\u200d"
_CONTROLS = "\n\t\r\x01\x7f\u2028"


def random_document(rng: Rng, *, own_folder: Path) -> Sketch:
    """Return a sketch of any content; some rasters lie in the sketch's own folder."""
    sketch = random_sketch(rng, share=0.3)
    for name in rng.choice(_CHANGES, int(rng.integers(8)), replace=False):
        sketch = CHANGES[name](rng, State(sketch, None, ()))
    return sketch.replace(
        name=_text(rng, _LETTERS + _CONTROLS),
        frame=_frame(rng),
        vectors={name: random_vectors(rng, name) for name in VECTOR_LAYERS if rng.random() < 0.7},
        rasters=tuple(_raster(rng, own_folder) for _ in range(int(rng.integers(4)))),
        drapes=tuple(_drape(rng, own_folder) for _ in range(int(rng.integers(3)))),
    )


def _text(rng: Rng, letters: str = _LETTERS, *, least: int = 0) -> str:
    return "".join(rng.choice(list(letters), int(rng.integers(least, 20))).tolist())


def _frame(rng: Rng) -> dict[str, object]:
    return {
        "crs": str(rng.choice(["", "EPSG:25832", "EPSG:3857", "+proj=utm +zone=33 +datum=WGS84"])),
        "east": float(rng.choice([0.0, 600_000.0, rng.uniform(-1e7, 1e7)])),
        "north": float(rng.choice([0.0, 5_270_000.0, rng.uniform(-1e7, 1e7)])),
        "vertical": str(rng.choice(["", "EPSG:5773"])),
    }


def _raster(rng: Rng, own_folder: Path) -> RasterSource:
    role, band = str(rng.choice(RASTER["role"].choices)), int(rng.choice([1, 2, 65535]))
    if rng.random() < 0.4:
        content = rng.bytes(int(rng.integers(200)))
        digest = sha256(content).hexdigest()
        return RasterSource(f"dem-{digest[:8]}.raster", role, band, digest, content, **_of_elevation(rng))
    folder = own_folder if rng.random() < 0.5 else Path("/elsewhere")
    name = _text(rng, _LETTERS.replace("/", "") + _CONTROLS, least=1)
    digest = sha256(name.encode()).hexdigest() if rng.random() < 0.5 else ""
    return RasterSource(str(folder / f"{name}.tif"), role, band, digest, **_of_elevation(rng))


def _drape(rng: Rng, own_folder: Path) -> DrapedLayer:
    edits = [
        Feature(
            LINE,
            (rng.normal(0, 1e4, (int(rng.integers(2, 9)), 2)),),
            properties={_text(rng, _LETTERS + _CONTROLS, least=1): float(rng.normal()), "text": _text(rng)},
            id=int(rng.integers(1 << 40)),
        )
        for _ in range(int(rng.integers(4)))
    ]
    name = _text(rng, _LETTERS.replace("/", ""), least=1)
    layer = DrapedLayer(str(own_folder / f"{name}.gpkg"), edits={edit.id: edit for edit in edits})
    return layer.replace(title=_text(rng), opacity=float(rng.random()), width=float(rng.uniform(0, 9)))


def _of_elevation(rng: Rng) -> dict[str, object]:
    return {
        "accuracy": float(rng.choice([-1.0, 0.0, rng.uniform(0.0, 100.0)])),
        "vertical": str(rng.choice(["", "EPSG:5773"])),
        "offset": float(rng.choice([0.0, rng.normal(0.0, 30.0)])),
    }


def random_vectors(rng: Rng, name: str) -> FeatureTable:
    """Return a layer with up to eight features and properties of every type."""
    kinds = [KINDS.index(kind) for kind in LAYERS[name].vectors]
    declared, count = list(vector_parameters(name).values()), int(rng.integers(9))
    columns = {_text(rng, least=1).strip(): kind for kind in (int, float, str) for _ in range(2)}
    columns = {key: kind for key, kind in columns.items() if key.isprintable()}
    columns = {key: kind for key, kind in columns.items() if key not in ("", "id", "label", *declared)}
    ids = rng.choice([*range(1, 40), (1 << 31) - 1], count, replace=False)
    features = []
    for number in range(count):
        values = {
            each.name: str(rng.choice(each.choices))
            if each.choices
            else each.kind(max(round(value, each.kind is float), each.low))
            for each in declared
            if rng.random() < 0.3
            for value in [float(rng.uniform(each.low, each.high))]
        }
        for key, kind in columns.items():
            if rng.random() < 0.6:
                values[key] = {
                    int: int(rng.integers(-(2**53), 2**53)),
                    float: float(rng.normal(0, 1e6)),
                    str: _text(rng, _LETTERS + _CONTROLS),
                }[kind]
        kind = int(rng.choice(kinds))
        label = int(rng.choice([1, 2, 255]))
        features.append(Feature(kind, _rings(rng, kind), label, values, int(ids[number])))
    return FeatureTable(name).edited(add=features)


def content_of(layer: FeatureTable) -> tuple[object, ...]:
    """Return everything in a layer, to compare it, however it is in pieces."""
    arrays = (layer.vertices, layer.rings, layer.parts, layer.kinds, layer.ids, layer.labels)
    columns = sorted((name, repr(np.asarray(column).tolist())) for name, column in layer.columns.items())
    return layer.layer, *(array.tobytes() for array in arrays), *columns


def _rings(rng: Rng, kind: int) -> tuple[np.ndarray, ...]:
    middle = rng.uniform(-5_000, 10_000, 2)
    if kind == POINT:
        return (middle[None],)
    if kind == LINE:
        steps = rng.normal(0, 300, (int(rng.integers(1, 12)), 2))
        return (np.concatenate([middle[None], middle + np.cumsum(steps, axis=0)]),)
    assert kind == AREA
    radius = rng.uniform(50, 2_000)
    holes = [
        _star(rng, middle + 0.2 * radius * np.array([side, 0.0]), 0.1 * radius)
        for side in (-1.0, 1.0)
        if rng.random() < 0.4
    ]
    return (_star(rng, middle, radius), *holes)


def _star(rng: Rng, middle: np.ndarray, radius: float) -> np.ndarray:
    """Return a ring that does not touch itself, in either direction."""
    corners = int(rng.integers(4, 12))
    angle = (np.arange(corners) + rng.uniform(-0.3, 0.3, corners)) * 2.0 * np.pi / corners
    reach = radius * rng.uniform(0.8, 1.0, corners)
    ring = middle + np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=-1)
    return ring[:: int(rng.choice([-1, 1]))]
