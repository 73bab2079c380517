"""Libraries that scatter Poisson-disk points, and Bridson's way compiled by numba.

Bridson 2007, "Fast Poisson disk sampling in arbitrary dimensions": darts at one to two distances around a
point that is drawn from a list; a point around which none of k darts finds a place leaves the list. All of
them work in one thread, as they come. Of the libraries that were tried fast-2d-poisson-disk-sampling (npm)
gives most points a second, faster_poisson (Rust) most at the density of darts; the former throws at the
least distance itself, so that its points lie denser than darts that fall anywhere.
"""

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from math import sqrt
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy
from scipy.stats import qmc

from sketchterrain.benchmarks.baselines.problem import Absent
from sketchterrain.benchmarks.timing import Lap, lap

FASTER_POISSON = "SKETCHTERRAIN_FASTER_POISSON"
"""Names the program that ``faster_poisson.rs`` becomes."""
NODE_MODULES = "SKETCHTERRAIN_NODE_MODULES"
"""Names the folder ``node_modules`` in which the JavaScript library is installed."""

_NODE_PACKAGE = "fast-2d-poisson-disk-sampling"
_NODE_SCRIPT = """
const Sampler = require(process.argv[1]);
const [side, distance, tries] = process.argv.slice(2, 5).map(Number);
const start = process.hrtime.bigint();
const points = new Sampler({shape: [side, side], radius: distance, tries}).fill();
const seconds = Number(process.hrtime.bigint() - start) * 1e-9;
const bytes = Buffer.from(Float64Array.from(points.flat()).buffer);
require('fs').writeSync(2, JSON.stringify({seconds}));
require('fs').writeFileSync(1, bytes);
"""


@dataclass(frozen=True)
class Scatterer:
    """A way to scatter points at least 1 apart over a square."""

    name: str
    scatter: Callable[[float, int, int], tuple[Lap, npt.NDArray[np.float64]]]


def in_numba() -> Scatterer | Absent:
    """Return Bridson's way compiled by numba, or say that numba is not installed."""
    name = "Bridson, numba"
    if find_spec("numba") is None:
        return Absent(name, "not installed: pip install numba")
    import numba

    fill = numba.njit(_fill)

    def scatter(side: float, trials: int, seed: int) -> tuple[Lap, npt.NDArray[np.float64]]:
        found: list[npt.NDArray[np.float64]] = []
        taken = lap(lambda: found.append(fill(side, trials, seed)))
        return taken, found[0]

    return Scatterer(f"{name} {numba.__version__}", scatter)


def in_scipy() -> Scatterer:
    """Return ``scipy.stats.qmc.PoissonDisk``."""

    def scatter(side: float, trials: int, seed: int) -> tuple[Lap, npt.NDArray[np.float64]]:
        found: list[npt.NDArray[np.float64]] = []

        def fill() -> None:
            # Its own unit is the square's side.
            engine = qmc.PoissonDisk(
                2, radius=1.0 / side, ncandidates=trials, rng=np.random.default_rng(seed)
            )
            found.append(side * np.asarray(engine.fill_space(), np.float64))

        return lap(fill), found[0]

    return Scatterer(f"scipy {scipy.__version__} qmc.PoissonDisk", scatter)


def in_node() -> Scatterer | Absent:
    """Return the JavaScript library, timed by itself in node; or say what is missing. It takes no seed."""
    node = shutil.which("node")
    if node is None:
        return Absent(_NODE_PACKAGE, "no node on the path")
    folder = os.environ.get(NODE_MODULES)
    if folder is None or not (Path(folder) / _NODE_PACKAGE).is_dir():
        return Absent(_NODE_PACKAGE, f"npm install it, and set {NODE_MODULES} to the folder node_modules")
    package = Path(folder).resolve() / _NODE_PACKAGE
    version = json.loads((package / "package.json").read_text(encoding="utf-8"))["version"]

    def scatter(side: float, trials: int, seed: int) -> tuple[Lap, npt.NDArray[np.float64]]:
        del seed
        return _timed_by_itself([node, "-e", _NODE_SCRIPT, str(package), str(side), "1", str(trials)])

    return Scatterer(f"{_NODE_PACKAGE} {version}", scatter)


def in_rust() -> Scatterer | Absent:
    """Return faster_poisson (``faster_poisson.rs``), timed by itself; or say that it is missing."""
    name = "faster_poisson, Rust"
    program = os.environ.get(FASTER_POISSON)
    if program is None or not Path(program).is_file():
        return Absent(name, f"build faster_poisson.rs, see docs/benchmarks.md, and set {FASTER_POISSON}")

    def scatter(side: float, trials: int, seed: int) -> tuple[Lap, npt.NDArray[np.float64]]:
        return _timed_by_itself([program, str(side), str(trials), str(seed)])

    return Scatterer(name, scatter)


def _timed_by_itself(command: list[str]) -> tuple[Lap, npt.NDArray[np.float64]]:
    """Run a program that writes points, and as JSON how many seconds it took without starting and writing."""
    done = subprocess.run(command, check=True, capture_output=True)
    points = np.frombuffer(done.stdout, np.float64).reshape(-1, 2)
    return Lap(float(json.loads(done.stderr)["seconds"])), points


def _fill(side: float, trials: int, seed: int) -> npt.NDArray[np.float64]:
    """Fill a square, in the Python that numba can compile."""
    np.random.seed(seed)  # noqa: NPY002 - numba's own generator has no other seed
    cells = int(side * sqrt(2.0)) + 1
    grid = np.full((cells, cells), -1, np.int32)
    most = cells * cells
    x, y = np.empty(most), np.empty(most)
    active = np.empty(most, np.int32)
    x[0], y[0] = side * np.random.random(), side * np.random.random()  # noqa: NPY002
    grid[int(y[0] * sqrt(2.0)), int(x[0] * sqrt(2.0))] = 0
    active[0] = 0
    count, waiting = 1, 1
    while waiting > 0:
        at = np.random.randint(waiting)  # noqa: NPY002
        centre = active[at]
        placed = False
        for _ in range(trials):
            angle = 2.0 * np.pi * np.random.random()  # noqa: NPY002
            away = sqrt(1.0 + 3.0 * np.random.random())  # noqa: NPY002
            px = x[centre] + away * np.cos(angle)
            py = y[centre] + away * np.sin(angle)
            if not (0.0 <= px < side and 0.0 <= py < side):
                continue
            i, j = int(px * sqrt(2.0)), int(py * sqrt(2.0))
            free = True
            for row in range(max(j - 2, 0), min(j + 3, cells)):
                for column in range(max(i - 2, 0), min(i + 3, cells)):
                    other = grid[row, column]
                    if other >= 0 and (x[other] - px) ** 2 + (y[other] - py) ** 2 < 1.0:
                        free = False
                        break
                if not free:
                    break
            if free:
                x[count], y[count] = px, py
                grid[j, i] = count
                active[waiting] = count
                count += 1
                waiting += 1
                placed = True
                break
        if not placed:
            waiting -= 1
            active[at] = active[waiting]
    return np.stack((x[:count], y[:count]), axis=-1)
