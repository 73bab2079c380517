"""Updates: time to find what changed between two recipes as the number of features grows."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import numpy as np

from sketchterrain.array_types import StructuredArray
from sketchterrain.benchmarks.culling import scattered_dunes, with_dunes
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import BARE, BARE_SEED, open_ground
from sketchterrain.benchmarks.report import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import Lap, TimedContext, alternate, lap, spread
from sketchterrain.terrain.changes import changed_areas
from sketchterrain.terrain.recipe import TerrainRecipe

_COLUMNS = (
    Column("features", "features N"),
    Column("changes", "changes k"),
    Column("rounds", "rounds"),
    Column("edited_ms", "edited, ms"),
    Column("inserted_ms", "inserted, ms"),
    Column("deleted_ms", "deleted, ms"),
    Column("p95_ms", "95 % of all, ms"),
    Column("areas", "areas"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Milliseconds until the changed areas of two recipes are known, over features N and changes k.

    Dune fields as for culling; k of them, anywhere, get another strength, are added, or are left out. Both
    recipes are made beforehand. Rounds alternate between all cases.
    """
    bare = open_ground(BARE, context).recipe
    cases: dict[tuple[int, int, str], tuple[TerrainRecipe, TerrainRecipe]] = {}
    for count in effort.update_features:
        dunes, _ = scattered_dunes(count)
        old = with_dunes(bare, dunes)
        for changes in effort.update_changes:
            for kind, change in _KINDS.items():
                selected = np.random.default_rng([BARE_SEED, changes]).choice(count, changes, replace=False)
                cases[count, changes, kind] = old, with_dunes(bare, change(dunes, np.sort(selected)))

    def compare(old: TerrainRecipe, new: TerrainRecipe) -> Lap:
        return lap(lambda: changed_areas(old, new))

    laps = alternate({case: partial(compare, *pair) for case, pair in cases.items()}, rounds=effort.rounds)
    seconds = {case: [each.wall for each in found] for case, found in laps.items()}
    rows = tuple(
        {
            **_row(count, changes, {kind: seconds[count, changes, kind] for kind in _KINDS}),
            "areas": len(changed_areas(*cases[count, changes, "edited"])),
        }
        for count in effort.update_features
        for changes in effort.update_changes
    )
    return Outcome((Table("Changed areas", _COLUMNS, rows),))


def _edited(dunes: StructuredArray, selected: np.ndarray) -> StructuredArray:
    dunes = dunes.copy()
    dunes["strength"][selected] += 1.0
    return dunes


def _inserted(dunes: StructuredArray, selected: np.ndarray) -> StructuredArray:
    added = dunes[selected].copy()
    added["id"] += 1  # ids are even
    return np.insert(dunes, selected + 1, added)


_KINDS: Final[Mapping[str, Callable[[StructuredArray, np.ndarray], StructuredArray]]] = {
    "edited": _edited,
    "inserted": _inserted,
    "deleted": np.delete,
}


def _row(count: int, changes: int, seconds: Mapping[str, list[float]]) -> Row:
    whole = [each for found in seconds.values() for each in found]
    medians = {f"{kind}_ms": spread(found).median * 1e3 for kind, found in seconds.items()}
    return {
        "features": count,
        "changes": changes,
        "rounds": len(whole) // len(seconds),
        **medians,
        "p95_ms": spread(whole).p95 * 1e3,
        "seconds": whole,
    }
