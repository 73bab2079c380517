"""Random sequences of changes: updated terrains equal new ones bit for bit, and only their areas change."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import count, pairwise

import numpy as np
import pytest

from sketchterrain.compute.context import ComputeContext
from sketchterrain.generation.building import build, rebuild
from sketchterrain.generation.terrain import Terrain
from sketchterrain.terrain.recipe import EVERYWHERE

from .conftest import tiers
from .sketch_edits import CHANGES, COMPILED, COSMETIC, SETTINGS, State, random_sketch
from .terrain_samples import Samples, differences, plants_of, samples_of

SEQUENCES = 40
RANDOM_SEQUENCES = 2000


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


class _CancelledError(Exception):
    """Raised by checkpoints."""


def cancel(terrain: Terrain, step: Step, checkpoints: int) -> None:
    """Begin to rebuild a terrain and cancel that at a checkpoint."""
    calls = count()

    def checkpoint() -> None:
        if next(calls) == checkpoints:
            raise _CancelledError

    with suppress(_CancelledError):
        rebuild(terrain, step.new.sketch, checkpoint=checkpoint)


def check(steps: Sequence[Step], name: str) -> Terrain:
    """Return the terrain after all steps; fail with the shortest run of steps that fails if any does."""
    terrain = steps[0].new
    for number, (before, step) in enumerate(pairwise(steps), 1):
        if number % 4 == 2:
            cancel(terrain, step, 5 * number)
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
    """Return the changes of all sequences but random ones: together all quick ones, local ones by threes."""
    quick = [name for name in CHANGES if name not in COMPILED]
    names = np.random.default_rng(5).permutation(quick).tolist()
    local = [name for name in names if name not in SETTINGS]
    steps = [[name] for name in names if name in SETTINGS] + [
        local[number : number + 3] for number in range(0, len(local), 3)
    ]
    order = np.random.default_rng(6).permutation(len(steps)).tolist()
    return [[steps[place] for place in order[number::SEQUENCES]] for number in range(SEQUENCES)]


def sequence(number: int, context: ComputeContext) -> list[Step]:
    return walk([20, number], hands()[number], context)


def random_sequence(number: int, context: ComputeContext) -> list[Step]:
    rng = np.random.default_rng([21, number])
    changes = [rng.choice(list(CHANGES), rng.integers(1, 4)).tolist() for _ in range(rng.integers(1, 6))]
    return walk([22, number], changes, context)


@tiers("number", [22], [27, *range(0, SEQUENCES, 12)], range(1, SEQUENCES, 2))
def test_updated_terrains_equal_new_ones(context, number) -> None:
    steps = sequence(number, context)
    last = check(steps, f"sequence {number}")
    if number == 0:
        assert plants_of(last) == plants_of(steps[-1].new)


@pytest.mark.soak
@pytest.mark.parametrize("first", range(0, RANDOM_SEQUENCES, 25))
def test_random_sequences(context, first) -> None:
    for number in range(first, first + 25):
        steps = random_sequence(number, context)
        last = check(steps, f"random sequence {number}")
        if number % 10 == 0:
            assert plants_of(last) == plants_of(steps[-1].new), number
