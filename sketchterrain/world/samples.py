"""Patches of a world, spread evenly over it: how long they take, and how many bytes they become."""

from __future__ import annotations

import math
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

import numpy as np

from sketchterrain.world.forms import store_of
from sketchterrain.world.grid import CHUNK, SHARD, Shard, World
from sketchterrain.world.ground import Ground
from sketchterrain.world.job import ENDINGS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from sketchterrain.world.grid import Level
    from sketchterrain.world.job import Job
    from sketchterrain.world.making import Maker

__all__ = ["Sampled", "evenly", "sample"]

_T = TypeVar("_T", bound=np.generic)

_FEWEST, _MOST = 6 * CHUNK**2, SHARD**2  # vertices
_SHARE: Final = 1 / 10  # of the world's vertices, that a sample takes at most, were it not for the fewest
_SIDE, _SMALL_SIDE = 2 * CHUNK, CHUNK  # vertices along a patch, and along one of a small world
_ENOUGH: Final = 4  # patches, to be large: launches of many vertices are what the work consists of
_PLASTIC: Final = 1.3247179572447460  # x³ = x + 1
_COARSE: Final = 3  # this level and all coarser ones are weighed together: 1.6 % of all vertices


class Sampled(NamedTuple):
    """What was measured.

    Attributes
    ----------
    patches, vertices : int
        That were evaluated.
    evaluating, writing : float
        Seconds a vertex.
    layers : dict of str to float
        Bytes on disk of all levels' shards, by layer.
    fixed : int
        Bytes of files that do not depend on the ground.
    """

    patches: int
    vertices: int
    evaluating: float
    writing: float
    layers: dict[str, float]
    fixed: int


def sample(job: Job, maker: Maker, *, progress: Callable[[float], None] | None = None) -> Sampled:
    """Evaluate some patches of a job's levels, have the job's own form write them elsewhere, and weigh them.

    They are the same patches each time. Each group of levels has as many of them as its share of the
    vertices.

    Parameters
    ----------
    job
    maker
        Of that job.
    progress
        Called with the share that is done, 0 … 1.

    Raises
    ------
    DeviceFailedError
        If the device gave up.
    SketchterrainError
        If the system cannot write temporary files.
    """
    levels = job.world.levels
    groups = [(level,) for level in levels[:_COARSE]] + ([levels[_COARSE:]] if len(levels) > _COARSE else [])
    wanted = min(max(_SHARE * job.world.vertices, _FEWEST), _MOST)
    side = _SIDE if wanted >= _ENOUGH * _SIDE**2 else _SMALL_SIDE
    _patch(maker, levels[-1], side, 0)  # the first launch builds programs
    bytes_of, fixed, patches, seen = dict.fromkeys(job.layers, 0.0), 0, 0, 0
    evaluating, writing = [], []
    for place, group in enumerate(groups, start=1):
        vertices = sum(level.columns * level.rows for level in group)
        count = max(round(wanted * vertices / job.world.vertices / side**2), 1)
        laps, grounds = [], []
        for number in range(count):
            start = time.perf_counter()
            grounds.append(_patch(maker, group[0], side, number))
            laps.append(time.perf_counter() - start)
        weights, fixed, wrote = _weighed(job, grounds)
        sampled = sum(ground.height.size for ground in grounds)
        later = laps[1:] or laps  # the first patch of a level finds out what all of them need
        evaluating.append((sum(later) / len(later) / grounds[0].height.size, vertices))
        writing.append((wrote / sampled, vertices))
        for layer, weight in weights.items():
            bytes_of[layer] += weight / sampled * vertices
        patches, seen = patches + count, seen + sampled
        if progress is not None:
            progress(place / len(groups))
    return Sampled(patches, seen, _mean(evaluating), _mean(writing), bytes_of, fixed)


def evenly(number: int) -> tuple[float, float]:
    """Return a place in the unit square; however many there are, the first ones cover it evenly.

    An additive recurrence by powers of the plastic number: Roberts (2018), "The unreasonable effectiveness of
    quasirandom sequences".
    """
    return (0.5 + number / _PLASTIC) % 1.0, (0.5 + number / _PLASTIC**2) % 1.0


def _patch(maker: Maker, level: Level, side: int, number: int) -> Ground:
    rows, columns = min(side, level.rows), min(side, level.columns)
    across, down = evenly(number)
    top, left = int(down * (level.rows - rows + 1)), int(across * (level.columns - columns + 1))
    shard = Shard(level.number, 0, 0)
    return maker.window(shard, top=top, left=left, rows=rows, columns=columns)


def _weighed(job: Job, grounds: Sequence[Ground]) -> tuple[dict[str, float], int, float]:
    """Write patches side by side; return their bytes by layer, those of all fixed files, and seconds."""
    across = min(len(grounds), SHARD // grounds[0].height.shape[1])
    down = math.ceil(len(grounds) / across)
    filled = [*grounds, *grounds][: across * down]  # the last row is filled up with the first ones
    height = _joined([ground.height for ground in filled], across)
    normal = _joined([ground.normal for ground in filled], across)
    materials = _joined([ground.materials for ground in filled], across)
    rows, columns = height.shape
    with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
        output = Path(folder) / f"sample{ENDINGS[job.form]}"
        world = World(0.0, 0.0, float(columns - 1), float(rows - 1), 1.0)
        store = store_of(replace(job, world=world, output=output))
        fixed = sum((store.folder / name).stat().st_size for name in store.create())
        start = time.perf_counter()
        names = store.write(Ground(Shard(0, 0, 0), height, normal, materials))
        wrote = time.perf_counter() - start
        share = len(grounds) / len(filled)
        weights = {
            layer: share * sum((store.folder / name).stat().st_size for name in names if layer in name)
            for layer in job.layers
        }
        return weights, fixed, share * wrote


def _joined(patches: Sequence[npt.NDArray[_T]], across: int) -> npt.NDArray[_T]:
    rows = [np.concatenate(patches[at : at + across], axis=-1) for at in range(0, len(patches), across)]
    return np.concatenate(rows, axis=-2)


def _mean(values: Sequence[tuple[float, int]]) -> float:
    """Return the mean of values with their weights."""
    return sum(value * weight for value, weight in values) / sum(weight for _, weight in values)
