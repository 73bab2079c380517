"""Tables of stages: what a sketch is made into, step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature
from typing import Any, Final

from sketchterrain.stages.runner import Runner

_PAINTED: Final = "painted."


@dataclass(frozen=True)
class Stage:
    """A pure function of declared inputs.

    Attributes
    ----------
    name
    function
        Its parameters are those `inputs`; `sketch`, a part of the sketch; `run`, for runs of its own.
    inputs
        Names of other stages.
    reads
        Fields of the sketch, as of `Sketch.part`; it has no access to others. ``painted.NAME`` is the image
        of a layer in the result of the stage ``painted``.
    cost
        Its share of the time that the whole takes, in proportion to others.
    hashed
        Whether its result is compared with earlier ones; if not, its digest is that of its inputs.
    fresh
        Whether it reads what may change without the sketch, and is run each time.
    """

    name: str
    function: Callable[..., Any]
    inputs: tuple[str, ...]
    reads: tuple[str, ...] = ()
    cost: float = 0.0
    hashed: bool = True
    fresh: bool = False


class StageTable(Mapping[str, Stage]):
    """Stages in the order in which they are declared: each after its inputs."""

    def __init__(self) -> None:
        self._stages: dict[str, Stage] = {}

    def __getitem__(self, name: str) -> Stage:
        return self._stages[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._stages)

    def __len__(self) -> int:
        return len(self._stages)

    def stage(
        self, *reads: str, cost: float = 0.0, hashed: bool = True, fresh: bool = False
    ) -> Callable[[Callable[..., Any]], Stage]:
        """Declare a function as the stage of its name, and its parameters as its inputs."""

        def declare(function: Callable[..., Any]) -> Stage:
            inputs = tuple(name for name in signature(function).parameters if name not in ("sketch", "run"))
            unknown = [name for name in inputs if name not in self._stages]
            if unknown:
                raise TypeError(
                    f"stage {function.__name__}: expected inputs declared before it, got {unknown}"
                )
            found = Stage(function.__name__, function, inputs, reads, cost, hashed, fresh)
            self._stages[found.name] = found
            return found

        return declare


class Evaluation:
    """Results of the stages of a sketch, each run when it is first asked for."""

    def __init__(self, table: StageTable, sketch: Any, run: Runner) -> None:
        self._table, self.sketch, self._run = table, sketch, run
        self._found: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._found:
            stage = self._table[name]
            inputs = [self[each] for each in stage.inputs]
            if stage.reads:
                inputs.insert(0, self._part(stage.reads))
            if stage.fresh:
                self._found[name] = stage.function(*inputs)
            else:
                self._found[name] = self._run(stage.function, *inputs, hashed=stage.hashed)
        return self._found[name]

    def _part(self, reads: Sequence[str]) -> Any:
        """Return the declared fields, and images of layers with their vectors."""
        images = [name.removeprefix(_PAINTED) for name in reads if name.startswith(_PAINTED)]
        part = self.sketch.part(*(name for name in reads if not name.startswith(_PAINTED)))
        if not images:
            return part
        return part.replace(layers={name: self["painted"][name] for name in images})
