"""The table of benchmarks."""

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from sketchterrain.benchmarks import (
    accuracy,
    batches,
    culling,
    drapes,
    elevation,
    erosion,
    flight,
    kernel_times,
    landform_grounds,
    landforms,
    live,
    noise,
    pictures,
    roads,
    speed,
    splines,
    synthetic_land,
    vector_scale,
    worlds,
)
from sketchterrain.benchmarks import points as blue_noise
from sketchterrain.benchmarks.draped_data import SEED
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import BARE_SEED
from sketchterrain.benchmarks.report import Tables
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.errors import InputError


@dataclass(frozen=True)
class Benchmark:
    """One benchmark."""

    name: str
    surface: str
    seed: str
    measure: Callable[[TimedContext, Effort], Tables]

    @property
    def method(self) -> str:
        """What is measured, how, in which unit."""
        return inspect.getdoc(self.measure) or ""


_PRESETS = "the presets"
_OWN = "each preset's own"

BENCHMARKS = {
    benchmark.name: benchmark
    for benchmark in (
        Benchmark(
            "kernels",
            f"{_PRESETS}, the last one's relief alone, and bare ground: 4096 m of default relief",
            f"{_OWN}; bare ground and noise: {BARE_SEED}",
            kernel_times.measure,
        ),
        Benchmark(
            "speed",
            "a square grid of vertices 1 m apart; bare ground, valley_river and alpine_range",
            f"noise {noise.SEED}, bare ground {BARE_SEED}, presets their own",
            speed.measure,
        ),
        Benchmark("culling", "dune fields at one density, in any world", str(BARE_SEED), culling.measure),
        Benchmark(
            "points",
            "a square, and its middle for spectra",
            f"0, spectra 0 … 19; places: {blue_noise.SEED}",
            blue_noise.measure,
        ),
        Benchmark(
            "splines", "splines and places that drive methods to failure", str(splines.SEED), splines.measure
        ),
        Benchmark("flight", "valley_river over 4096 m, and a round over it", _OWN, flight.measure),
        Benchmark("live", "20 shapes on 512 px, and views of presets", str(live.SEED), live.measure),
        Benchmark("pictures", "valley_river, and flights over presets", _OWN, pictures.measure),
        Benchmark("elevation", "generated DEM grids", str(elevation.SEED), elevation.measure),
        Benchmark("roads", "Andorra, its SRTM and OpenStreetMap", _OWN, roads.measure),
        Benchmark(
            "scale",
            "a synthetic country of fields and roads of 100 × 100 km",
            str(synthetic_land.SEED),
            vector_scale.measure,
        ),
        Benchmark("drapes", f"{drapes.GROUND}, synthetic layers", f"its own; layers: {SEED}", drapes.measure),
        Benchmark("erosion", "the middle of alpine_range, 8 km wide in a full run", _OWN, erosion.measure),
        Benchmark(
            "landforms",
            "painted sketches of 7680 m; realism of the presets too (quick run: of one)",
            f"{_OWN}; painted sketches 0 and on; paint: {landform_grounds.SEED}",
            landforms.measure,
        ),
        Benchmark("batch", "valley_river over 6144 m", "1 and on", batches.measure),
        Benchmark("world", "valley_river and what lies beyond it", _OWN, worlds.measure),
        Benchmark(
            "accuracy",
            "tiles drawn from all of valley_river and its relief alone (full run: of desert_mountains too)",
            f"{_OWN}; draw of tiles: {accuracy.TILE_SEED}",
            accuracy.measure,
        ),
    )
}
"""Every benchmark by name, in the order they run."""


def choose(names: Iterable[str]) -> tuple[Benchmark, ...]:
    """Return the named benchmarks in the order they run, each once; all of them for no name."""
    wanted = set(names)
    unknown = sorted(wanted - set(BENCHMARKS))
    if unknown:
        raise InputError(f"no benchmark {unknown[0]!r}; there are: {', '.join(BENCHMARKS)}")
    return tuple(b for b in BENCHMARKS.values() if not wanted or b.name in wanted)
