"""Tables of stages: what a sketch is made into, step by step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from inspect import signature
from typing import Any, Final

from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Runner

_PAINTED: Final = "painted."


@dataclass(frozen=True)
class Stage:
    """A pure function of declared inputs."""

    name: str
    function: Callable[..., Any]  # of `sketch`, a part of it, of the inputs, and of `run`, for its own runs
    inputs: tuple[str, ...]  # names of other stages
    # Fields of the sketch, as of `Sketch.part`; ``painted.NAME`` is a layer's image in the stage ``painted``.
    reads: tuple[str, ...]
    hashed: bool  # whether its result is compared with earlier ones; else its digest is that of its inputs
    fresh: bool  # whether it reads what may change without the sketch, and runs each time
    stored: bool  # whether its result may be kept on disk
    cost: int  # a hint for progress: how long it takes, relative to the others


class StageTable(dict[str, Stage]):
    """Stages in the order in which they are declared: each after its inputs."""

    def stage(
        self,
        *reads: str,
        hashed: bool = True,
        fresh: bool = False,
        stored: bool = False,
        cost: int = 1,
    ) -> Callable[[Callable[..., Any]], Stage]:
        """Declare a function as the stage of its name, and its parameters as its inputs."""

        def declare(function: Callable[..., Any]) -> Stage:
            inputs = tuple(name for name in signature(function).parameters if name not in ("sketch", "run"))
            unknown = [name for name in inputs if name not in self]
            if unknown:
                raise TypeError(
                    f"stage {function.__name__}: expected inputs declared before it, got {unknown}"
                )
            found = Stage(function.__name__, function, inputs, reads, hashed, fresh, stored, cost)
            self[found.name] = found
            return found

        return declare


class Evaluation:
    """Results of the stages of a sketch, each run when it is first asked for.

    `progress` is called after each stage, and within long ones, with the share done of the whole table's
    costs, 0 … 1; a stage whose result was stored costs nothing.
    """

    def __init__(
        self,
        table: StageTable,
        sketch: Any,
        run: Runner,
        progress: Callable[[float], None] = lambda _: None,
    ) -> None:
        self._table, self.sketch, self._run, self._progress = table, sketch, run, progress
        self._found: dict[str, Any] = {}
        self._done, self._left, self._share = 0, sum(stage.cost for stage in table.values()), 0.0

    def __getitem__(self, name: str) -> Any:
        if name not in self._found:
            stage = self._table[name]
            inputs = [self[each] for each in stage.inputs]
            if stage.reads:
                inputs.insert(0, self._part(stage.reads))
            runs, self._run.progress = self._run.count, partial(self._report, stage)
            if stage.fresh:
                self._found[name] = stage.function(*inputs)
            else:
                options = {"hashed": stage.hashed, "stored": stage.stored}
                self._found[name] = self._run(stage.function, *inputs, **options)
            self._left -= stage.cost
            self._done += stage.cost if stage.fresh or self._run.count > runs else 0
            self._report()
        return self._found[name]

    def _report(self, stage: Stage | None = None, share: float = 0.0) -> None:
        """Report the share done, with that of a stage that runs."""
        part = share * stage.cost if stage else 0.0
        self._share = max(self._share, (self._done + part) / max(self._left + self._done, 1))
        self._progress(self._share)

    def supposing(self, results: Mapping[str, Any]) -> Evaluation:
        """Return the stages of the same sketch if some of them had other results."""
        other = Evaluation(self._table, self.sketch, self._run)
        other._found.update(results)
        return other

    def _part(self, reads: Sequence[str]) -> Any:
        """Return the declared fields, and images of layers with their vectors."""
        images = [name.removeprefix(_PAINTED) for name in reads if name.startswith(_PAINTED)]
        part = part_of(self.sketch, *(name for name in reads if not name.startswith(_PAINTED)))
        if not images:
            return part
        return part.replace(layers={name: self["painted"][name] for name in images})
