"""Self-test: whether a device computes the program's bits, on a small terrain with every kind of feature.

Run as a program, it evaluates that terrain on the device with the given index and writes it to a file.
"""

import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array, Float64Array, FloatArray
from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import Device, list_devices
from sketchterrain.compute.device_check import DeviceCheck, cached_on_disk, check_device
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import SketchterrainError
from sketchterrain.features.table import AREA, LINE, Feature, FeatureTable
from sketchterrain.generation.building import make_recipe
from sketchterrain.generation.terrain import Terrain
from sketchterrain.io import resources
from sketchterrain.io.system import ChildFailedError, ChildTimedOutError, module_result
from sketchterrain.schema.parameters import Properties
from sketchterrain.terrain.host_heights import host_heights
from sketchterrain.terrain.recipe import TerrainRecipe

_EXTENT = 1024.0
_PIXELS = 32
_VERTICES = 33
_PLANTS = (300.0, 100.0, 620.0, 420.0)  # m: west, south, east, north
_POINTS = 256
_TIMEOUT = 180.0  # s: a driver may compile all kernels
_CLOSE = 10.0  # mm: float32 heights of this terrain are far closer to float64
# Painted rows (from the north) and columns of each layer.
_PAINTED = {
    "mountain": (slice(3, 12), slice(18, 30)),
    "hill": (slice(4, 12), slice(2, 10)),
    "river": (slice(15, 17), slice(0, 32)),
    "dune": (slice(20, 30), slice(2, 12)),
    "forest": (slice(20, 30), slice(14, 20)),
    "lake": (slice(22, 28), slice(23, 30)),
    "material": (slice(13, 15), slice(4, 9)),
}

# Vectors: layer, vertices (m), properties: a road with a bridge across the river, a pad, land of each use.
_DRAWN: tuple[tuple[str, int, list[list[float]], Properties], ...] = (
    ("road", LINE, [[300.0, 410.0], [520.0, 430.0], [560.0, 640.0], [430.0, 700.0]], {}),
    ("pad", AREA, [[600.0, 420.0], [640.0, 410.0], [645.0, 440.0]], {}),
    ("landuse", AREA, [[310.0, 200.0], [420.0, 190.0], [430.0, 300.0]], {"use": "field"}),
    ("landuse", AREA, [[420.0, 190.0], [560.0, 210.0], [430.0, 300.0]], {"use": "meadow"}),
    ("landuse", AREA, [[310.0, 200.0], [430.0, 300.0], [330.0, 390.0]], {"use": "forest"}),
    ("landuse", AREA, [[430.0, 300.0], [560.0, 210.0], [600.0, 380.0]], {"use": "built_up"}),
)


@dataclass(frozen=True)
class Verdict:
    """Result of the self-test."""

    bits: str  # 'same', 'other' or 'failed'
    detail: str  # the comparison, the deviation, or the failure

    @property
    def line(self) -> str:
        """Everything in one line."""
        bits = {"same": "same bits", "other": "other bits"}.get(self.bits, self.bits)
        return f"{bits} ({self.detail})" if self.bits == "same" else f"{bits}: {self.detail}"


@dataclass(frozen=True)
class _Probe:
    """The small terrain as evaluated by a device."""

    height: Float32Array
    rest: dict[str, npt.NDArray[np.generic]]


@cache
def self_test(device: Device, *, compare: bool = True) -> Verdict:
    """Return whether a device computes the program's bits; cached on disk by the drivers' versions.

    Its arithmetic must be that of IEEE 754, step by step. With `compare` the small terrain must also match a
    CPU driver whose bits the tests hold, or, without another one, float64 on the host within a tolerance.
    Everything runs in child processes, which a driver may crash.
    """
    check = check_device(device)
    if check.failure:
        return Verdict("failed", check.failure)
    if not compare:
        wrong = _named(check.wrong)
        return Verdict("other", *wrong) if wrong else Verdict("same", "correct arithmetic")
    others = tuple(
        other
        for other in list_devices()
        if other != device and other.known and check_device(other) == DeviceCheck("")
    )
    sources = (resources.kernels_digest(), Path(__file__).read_text(encoding="utf-8"))
    try:
        found = cached_on_disk(
            "terrain", (device, *others), sources, lambda: asdict(_compared(device, others, check.wrong))
        )
    except ChildTimedOutError as error:
        return Verdict("failed", str(error))
    return Verdict(**found)


@cache
def probe_terrain() -> Sketch:
    """Return the sketch of the small terrain: every kind of feature on noise."""
    layers = {}
    for name, painted in _PAINTED.items():
        layers[name] = np.zeros((_PIXELS, _PIXELS), np.uint8)
        layers[name][painted] = 1
    vectors: dict[str, FeatureTable] = {}
    for name, kind, places, own in _DRAWN:
        layer = vectors.get(name, FeatureTable(name))
        vectors[name] = layer.edited(add=[Feature(kind, (np.array(places),), 1, own)])
    return Sketch(name="self-test", extent=_EXTENT, seed=1, layers=layers, vectors=vectors)


@cache
def _probe_recipe() -> TerrainRecipe:
    return make_recipe(probe_terrain())


def _probe(device: Device) -> _Probe:
    terrain = Terrain(probe_terrain(), _probe_recipe(), ComputeContext(device))
    raster = terrain.raster(_VERTICES)
    tile = terrain.tile(3, 4, 5)
    heights = (raster.height, tile.height, tile.parent_height, terrain.heights(*_points_at()))
    rest = {
        "normals": np.concatenate([part.ravel() for part in (raster.normal, tile.normal)]),
        "materials": np.concatenate([part.ravel() for part in (raster.materials, tile.materials)]),
        "plants": terrain.foliage(*_PLANTS),
    }
    return _Probe(np.concatenate([part.ravel() for part in heights]), rest)


def _points_at() -> tuple[Float64Array, Float64Array]:
    east = np.linspace(0, _EXTENT, _POINTS)
    return east, (east * 7.3) % _EXTENT


def _compared(device: Device, others: tuple[Device, ...], wrong: tuple[str, ...]) -> Verdict:
    try:
        result = _probe_in_child(device)
    except ChildTimedOutError:
        raise
    except ChildFailedError as error:
        return Verdict("failed", str(error))
    for other in others:
        with suppress(ChildFailedError):  # skip drivers that fail
            return _against(_probe_in_child(other), other.platform, result, wrong)
    return _against_float64(result, wrong)


@cache
def _probe_in_child(device: Device) -> _Probe:
    result = module_result(
        "sketchterrain.generation.self_test", str(device.index), name="the self-test", timeout=_TIMEOUT
    )
    with np.load(BytesIO(result)) as arrays:
        return _Probe(arrays["height"], {name: arrays[name] for name in ("normals", "materials", "plants")})


def _against(expected: _Probe, name: str, result: _Probe, wrong: tuple[str, ...]) -> Verdict:
    parts = [part for part, values in result.rest.items() if not np.array_equal(values, expected.rest[part])]
    deviation = _millimetres(result.height, expected.height)
    if not (parts or deviation or wrong):
        return Verdict("same", f"as {name}")
    others = [f"other {' and '.join(parts)}"] if parts else []
    return Verdict(
        "other", "; ".join([f"off by up to {deviation:.3g} mm from {name}", *others, *_named(wrong)])
    )


def _against_float64(result: _Probe, wrong: tuple[str, ...]) -> Verdict:
    exact = host_heights(_probe_recipe(), *_points_at(), cell_size=0.0)
    deviation = _millimetres(result.height[-_POINTS:], exact)
    line = f"off by up to {deviation:.3g} mm from float64"
    if wrong or deviation > _CLOSE:
        return Verdict("other", "; ".join([line, *_named(wrong)]))
    return Verdict("same", f"correct arithmetic, {line}, no other driver to compare with")


def _millimetres(one: FloatArray, other: FloatArray) -> float:
    return float(np.max(np.abs(one.astype(np.float64) - other))) * 1e3


def _named(wrong: tuple[str, ...]) -> list[str]:
    return [f"wrong in {', '.join(wrong)}"] if wrong else []


def _main(index: str, file: str) -> None:
    probe = _probe(list_devices()[int(index)])
    with Path(file).open("wb") as stream:
        np.savez(stream, allow_pickle=False, height=probe.height, **probe.rest)


if __name__ == "__main__":
    try:
        _main(*sys.argv[1:])
    except SketchterrainError as failure:
        sys.exit(str(failure))
