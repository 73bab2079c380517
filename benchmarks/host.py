"""Times of the loops of ``kernels/host/``."""

from collections.abc import Callable
from copy import deepcopy
from functools import partial
from typing import Any, Final

from sketchterrain.benchmarks import host_drainage, host_elevation, host_flow, host_mesh, host_painting
from sketchterrain.benchmarks.report import Row, Table
from sketchterrain.benchmarks.timing import Lap, alternate, lap, spread
from sketchterrain.host.library import HostFunction, host_function

SAMPLES: Final[dict[str, Callable[[int], tuple[Any, ...]]]] = {
    **host_flow.SAMPLES,
    **host_drainage.SAMPLES,
    **host_mesh.SAMPLES,
    **host_elevation.SAMPLES,
    **host_painting.SAMPLES,
}
"""Functions of fresh arguments by the side of a raster or a number of items."""


def times(side: int, rounds: int) -> Table:
    """Time each loop on its sample, on one thread; a sample is of a raster of so many cells a side."""
    works = {name: partial(_lap, host_function(name), sample(side)) for name, sample in SAMPLES.items()}
    rows: list[Row] = []
    for name, laps in alternate(works, rounds=rounds).items():
        seconds = [one.wall for one in laps]
        rows.append({"loop": name, "side": side, **spread(seconds).cells(), "seconds": seconds})
    return Table("Loops on the host", tuple(rows))


def _lap(function: HostFunction, arguments: tuple[Any, ...]) -> Lap:
    """Call a loop once; what it changes in place is as before each time."""
    fresh = deepcopy(arguments)
    return lap(lambda: function(*fresh))
