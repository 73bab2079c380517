"""Random sequences of changes: updated terrains equal new ones bit for bit, and only their areas change."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import pytest

from sketchterrain.array_types import Bounds
from sketchterrain.compute.context import ComputeContext
from sketchterrain.terrain.building import build, rebuild
from sketchterrain.terrain.changes import EVERYWHERE
from sketchterrain.terrain.terrain import Terrain

from .sketch_edits import CHANGES, COSMETIC, SETTINGS, State, random_sketch

SEQUENCES = 20
RANDOM_SEQUENCES = 2000

_CELLS = (0.0, 1 / 100)  # of the extent
_POINTS = ((0.5, 0.5, 1.3, 800), (-30.0, 20.0, 0.1, 50))  # x, y and width of squares in extents; how many
_QUADS = 32
# From far to near, parents before children: level, and position in extents.
_TILES = (
    *((-1, 0.5, 0.5), (0, 0.5, 0.5), (2, 0.4, 0.3), (3, 0.45, 0.3), (6, 0.5, 0.5)),
    *((1, -0.4, -0.4), (3, -0.2, 0.7), (12, 0.3, 0.6)),
)
_PLANTS = (("woody", 60.0), ("grass", 4.0))  # storey and side of a square (m) in the middle


@dataclass(frozen=True, eq=False)
class Samples:
    """Values of one part of a terrain, and where they are: x, y (m) and the cell size that they depend on."""

    at: np.ndarray  # (n, 2) m
    cell: float  # m, by which changed areas are widened
    values: np.ndarray  # (n, bytes)

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, cell: float, values: np.ndarray) -> Samples:
        flat = np.ascontiguousarray(values).reshape(x.size, -1)
        return cls(np.stack([x.ravel(), y.ravel()], axis=-1), cell, flat.view(np.uint8))


def samples_of(terrain: Terrain) -> dict[str, Samples]:
    """Return heights at points, vertices of tiles with their parents' values, and one tile in floats."""
    extent, found = terrain.extent, {}
    rng = np.random.default_rng(1)
    squares = [rng.uniform(-0.5, 0.5, (count, 2)) * wide + [u, v] for u, v, wide, count in _POINTS]
    x, y = np.concatenate(squares).T * extent
    for cell in (each * extent for each in _CELLS):
        found[f"points, cell {cell:g} m"] = Samples.of(x, y, 0.0, terrain.heights(x, y, cell_size=cell))
    keys = [(level, int(np.floor(u * 2.0**level)), int(np.floor(v * 2.0**level))) for level, u, v in _TILES]
    slot = {key: number for number, key in enumerate(keys)}
    parents = [slot.get((level - 1, column >> 1, row >> 1), -1) for level, column, row in keys]
    store = terrain.vertex_store(len(keys), quads=_QUADS)
    facts = terrain.write_tiles(keys, range(len(keys)), parents, store)
    vertices = store.download()
    for key, tile, parent in zip(keys, vertices, parents, strict=True):
        width = extent * 2.0 ** -key[0]
        line = np.linspace(0.0, width, _QUADS + 1)
        x, y = np.meshgrid(key[1] * width + line, key[2] * width + line[::-1])
        parts = vertices.dtype.names
        own = [name for name in parts if not name.startswith("parent")]
        found[f"tile {key}"] = Samples.of(x, y, width / _QUADS, _columns(tile, own))
        if parent >= 0:
            others = [name for name in parts if name.startswith("parent")]
            found[f"parent of {key}"] = Samples.of(x, y, 3 * width / _QUADS, _columns(tile, others))
    nowhere = np.full(len(keys), np.nan)
    found["facts of tiles"] = Samples.of(nowhere, nowhere, 0.0, _columns(facts, facts.dtype.names))
    tile = terrain.tile(0, 0, 0)
    x, y = np.meshgrid(*(np.linspace(0.0, extent, len(tile.height)),) * 2)
    values = np.concatenate([tile.height[..., None], tile.normal, tile.materials], axis=-1)
    found["floats of (0, 0, 0)"] = Samples.of(x, y[::-1], tile.cell_size, values)
    return found


def _columns(rows: np.ndarray, names: Iterable[str]) -> np.ndarray:
    """Return the bytes of some columns of a structured array, (rows, bytes)."""
    flat = np.ascontiguousarray(rows).ravel()
    parts = [np.ascontiguousarray(flat[name]).reshape(flat.size, -1).view(np.uint8) for name in names]
    return np.concatenate(parts, axis=-1)


def differences(one: dict[str, Samples], other: dict[str, Samples], areas: Sequence[Bounds] = ()) -> str:
    """Return in which parts two terrains differ outside of some areas; empty if they are bit-equal there."""
    lines = []
    for name, samples in one.items():
        changed = (samples.values != other[name].values).any(axis=-1)
        x, y, wider = *samples.at.T, samples.cell * (1 + 1e-9)
        for west, south, east, north in areas:
            changed &= (x < west - wider) | (x > east + wider) | (y < south - wider) | (y > north + wider)
        if changed.any():
            lines.append(f"{name}: {changed.sum()} of {changed.size}, first at {samples.at[changed][0]}")
    return "\n".join(lines)


def plants_of(terrain: Terrain) -> bytes:
    middle, found = 0.5 * terrain.extent, [terrain.features.points.tobytes()]
    for storey, side in _PLANTS:
        found.append(terrain.foliage(middle, middle, middle + side, middle + side, storey=storey).tobytes())
    return b"".join(found)


@dataclass(frozen=True, eq=False)
class Step:
    """The names of the changes that lead to a sketch, and its newly built terrain."""

    changes: tuple[str, ...]
    new: Terrain

    @cached_property
    def samples(self) -> dict[str, Samples]:
        return samples_of(self.new)


def failure(terrain: Terrain, before: Step, step: Step) -> tuple[Terrain, str]:
    """Return the terrain of the step before updated to a step, and what is wrong with it; "" if nothing."""
    assert before.samples  # fills the caches of a new terrain
    after, areas = rebuild(terrain, step.new.sketch)
    wrong = differences(samples_of(after), step.samples)
    if wrong:
        wrong = f"not those of a new terrain: {wrong}"
    elif after.extent != terrain.extent:
        wrong = "" if areas == [EVERYWHERE] else "another extent does not change everything"
    elif missed := differences(before.samples, step.samples, areas):
        wrong = f"changed outside of the areas: {missed}"
    elif areas and set(step.changes) <= set(COSMETIC):
        wrong = f"changed areas {areas}"
    return after, wrong


def new_terrain(step: Step) -> Terrain:
    """Return a new terrain of a step's sketch whose caches are full."""
    terrain = build(step.new.sketch, device=step.new.context)
    samples_of(terrain)
    return terrain


def check(steps: Sequence[Step], name: str) -> Terrain:
    """Return the terrain after all steps; fail with the shortest run of steps that fails if any does."""
    terrain = steps[0].new
    for number, (before, step) in enumerate(pairwise(steps), 1):
        terrain, wrong = failure(terrain, before, step)
        if wrong:
            first = shortest(steps[: number + 1])
            changes = "; ".join(", ".join(each.changes) for each in steps[first + 1 : number + 1])
            pytest.fail(f"{name}: from a new terrain of step {first} to step {number}, by {changes}: {wrong}")
    return terrain


def shortest(steps: Sequence[Step]) -> int:
    """Return the latest step to start from, so that the last one still fails."""
    for first in range(len(steps) - 2, 0, -1):
        terrain, wrong = new_terrain(steps[first]), ""
        for before, step in pairwise(steps[first:]):
            terrain, wrong = failure(terrain, before, step)
        if wrong:
            return first
    return 0


def walk(seed: Sequence[int], changes: Sequence[Sequence[str]], context: ComputeContext) -> list[Step]:
    """Return a random sketch and those that follow from it by changes, given by name for each step."""
    rng = np.random.default_rng(seed)
    steps = [Step((), build(random_sketch(rng), device=context))]
    for names in changes:
        sketch, earlier = steps[-1].new.sketch, [step.new.sketch for step in steps]
        for name in names:
            sketch = CHANGES[name](rng, State(sketch, steps[-1].new.features, earlier))
        steps.append(Step(tuple(names), build(sketch, device=context)))
    return steps


def hands() -> list[list[list[str]]]:
    """Return the changes of each sequence of the default tier: together all kinds, local ones by threes."""
    names = np.random.default_rng(5).permutation(list(CHANGES)).tolist()
    local = [name for name in names if name not in SETTINGS]
    steps = [[name] for name in names if name in SETTINGS] + [
        local[number : number + 3] for number in range(0, len(local), 3)
    ]
    order = np.random.default_rng(6).permutation(len(steps)).tolist()
    return [[steps[place] for place in order[number::SEQUENCES]] for number in range(SEQUENCES)]


def sequence(number: int, context: ComputeContext) -> list[Step]:
    return walk([20, number], hands()[number], context)


@pytest.mark.parametrize("number", range(SEQUENCES))
def test_updated_terrains_equal_new_ones(context, number) -> None:
    steps = sequence(number, context)
    last = check(steps, f"sequence {number}")
    if number == 0:
        assert plants_of(last) == plants_of(steps[-1].new)


@pytest.mark.soak
@pytest.mark.parametrize("first", range(0, RANDOM_SEQUENCES, 25))
def test_random_sequences(context, first) -> None:
    for number in range(first, first + 25):
        rng = np.random.default_rng([21, number])
        changes = [rng.choice(list(CHANGES), rng.integers(1, 4)).tolist() for _ in range(rng.integers(1, 6))]
        steps = walk([22, number], changes, context)
        last = check(steps, f"random sequence {number}")
        if number % 10 == 0:
            assert plants_of(last) == plants_of(steps[-1].new), number
