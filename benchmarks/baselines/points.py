"""Libraries that scatter Poisson-disk points, and Bridson's way compiled by numba.

Bridson 2007, "Fast Poisson disk sampling in arbitrary dimensions": darts at one to two distances around a
point that is drawn from a list; a point around which none of k darts finds a place leaves the list. All of
them work in one thread, as they come. Of the libraries that were tried fast-2d-poisson-disk-sampling (npm)
gives most points a second, faster_poisson (Rust) most at the density of darts; the former throws at the
least distance itself, so that its points lie denser than darts that fall anywhere.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from math import ceil, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import scipy
from scipy.spatial import cKDTree
from scipy.stats import qmc

from sketchterrain.benchmarks.baselines.noise import Absent
from sketchterrain.benchmarks.timing import Lap, lap
from sketchterrain.geometry.hashing import hash_keys

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

    Points = npt.NDArray[np.float64]

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
        return Absent(name, "not installed: pip install 'sketchterrain[peers]'")
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


_FINEST = 1e-7  # of the distance: free ground that is narrower is as good as none


def throw_darts(side: float, *, seed: int) -> Points:
    """Throw darts at a square whose opposite edges are one, until no other fits."""
    rng = np.random.default_rng(seed)
    count = int(np.ceil(side * np.sqrt(2.0)))
    squares = np.stack(np.divmod(np.arange(count * count), count), axis=-1).astype(np.int64)
    width = side / count
    points = np.empty((0, 2))
    while len(squares) and width > _FINEST:
        darts = (squares[rng.integers(len(squares), size=len(squares))] + rng.random(squares.shape)) * width
        points = np.concatenate([points, _staying(darts, points, side)])
        squares = (2 * squares[:, None] + ((0, 0), (0, 1), (1, 0), (1, 1))).reshape(-1, 2)
        width /= 2
        middle = np.asarray((squares + 0.5) * width, np.float64)
        covered = 1.0 - width / np.sqrt(2.0)
        # A square whose middle is nearer to a point than this lies within its disc.
        squares = squares[~_near(middle, points, side, covered)]
    return points


def _staying(darts: Points, points: Points, side: float) -> Points:
    """Return the darts that stay, thrown in this order after the points."""
    darts = darts[~_near(darts, points, side, 1.0)] % side
    stays = np.ones(len(darts), np.bool_)
    pairs = cKDTree(darts, boxsize=np.full(2, side)).query_pairs(1.0, output_type="ndarray")
    for first, second in pairs[np.argsort(pairs[:, 0], kind="stable")].tolist():
        if stays[first]:
            stays[second] = False
    return darts[stays]


def _near(places: Points, points: Points, side: float, distance: float) -> npt.NDArray[np.bool_]:
    """Return which places are nearer than a distance to a point."""
    if not len(points) or distance <= 0.0:
        return np.zeros(len(places), np.bool_)
    found, _ = cKDTree(points, boxsize=np.full(2, side)).query(places % side, distance_upper_bound=distance)
    return np.asarray(np.isfinite(found))


_FILE = "baselines/phase_groups.cl"
_GROUP = 64
_EMPTY = -1


@dataclass(frozen=True, eq=False)
class _CellLevel:
    """Cells of one size: how many along the side, how wide, how far points reach, and each one's point."""

    columns: int
    cell: float
    reach: int
    index: Any


class PhaseGroups:
    """Points at least a distance apart on a square."""

    def __init__(
        self,
        context: ComputeContext,
        side: float,
        distance: float,
        trials: int,
        *,
        levels: int = 3,
        rounds: bool = False,
    ) -> None:
        self._context, self._side, self._distance = context, side, distance
        self._trials, self._rounds = trials, rounds
        cell = distance / sqrt(2.0)
        coarsest = ceil(ceil(side / cell) / 2 ** (levels - 1))
        self._levels = []
        for level in range(levels):
            columns, wide = coarsest << level, cell * 2 ** (levels - 1 - level)
            index = context.upload(np.full(columns**2, _EMPTY, np.int32), writable=True)
            self._levels.append(_CellLevel(columns, wide, ceil(distance / wide), index))
        self._nothing = np.full(coarsest**2, _EMPTY, np.int32)
        self._most = int(1.3 * (side / distance + 1.0) ** 2) + 1  # circles of diameter 1 do not lie denser
        self._points = context.empty((self._most, 2), np.float32)
        self._count = context.upload(np.zeros(1, np.int32), writable=True)

    def points(self, seed: int) -> npt.NDArray[np.float32]:
        """Return the points of a seed, m, shape (n, 2), in no order."""
        context = self._context
        start = np.zeros(1, np.int32)
        events = [
            context.write(self._levels[0].index, self._nothing),
            context.write(self._count, start),
        ]
        rng = np.random.default_rng(seed)
        salt = np.uint32(hash_keys(seed, "phase groups") & np.uint64(0xFFFFFFFF))
        for number, level in enumerate(self._levels):
            if number:
                self._refine(self._levels[number - 1], level)
            turns = [(t, 1) for t in range(self._trials)] if self._rounds else [(0, self._trials)]
            for first, trials in turns:
                for group in rng.permutation((level.reach + 1) ** 2).tolist():
                    self._throw(level, group, first, trials, salt)
        found = int(context.download(self._count, 1, np.int32)[0])
        for event in events:
            context.wait(event)
        return context.download(self._points, (found, 2), np.float32)

    def _throw(self, level: _CellLevel, group: int, first: int, trials: int, salt: np.uint32) -> None:
        row, column = divmod(group, level.reach + 1)
        along = -(-level.columns // (level.reach + 1))
        numbers = (level.columns, level.reach, level.reach + 1, column, row, first, trials)
        columns, reach, apart, *rest = (np.int32(number) for number in numbers)
        lengths = (np.float32(length) for length in (level.cell, self._side, self._distance))
        written = (level.index, self._points, self._count)
        self._context.launch(
            _FILE,
            "throw_darts",
            (_rounded_up(along), along),
            *(*written, columns, *lengths, reach, apart, *rest, salt),
            group=(_GROUP, 1),
        )

    def _refine(self, coarse: _CellLevel, fine: _CellLevel) -> None:
        size = (_rounded_up(coarse.columns), coarse.columns)
        given = (coarse.index, fine.index, self._points, np.int32(coarse.columns), np.float32(fine.cell))
        self._context.launch(_FILE, "refine", size, *given, group=(_GROUP, 1))


def _rounded_up(number: int) -> int:
    return -(-number // _GROUP) * _GROUP
