"""What a batch makes: each sketch with each seed and each value of its settings, and where it is put."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from sketchterrain.batch.settings import painted, with_settings
from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.sketch import load_sketch
from sketchterrain.sketch.parameter import number_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.batch.settings import Settings, Swept
    from sketchterrain.sketch import Sketch

__all__ = ["MOST_ITEMS", "Item", "Source", "plan", "read_sources"]

MOST_ITEMS = 10_000
"""Of one batch: the manifest is written anew after each."""
_LONGEST = 120  # characters of a folder's name
_UNSAFE = re.compile(r"[^\w.=+-]", re.ASCII)


@dataclass(frozen=True)
class Source:
    """A sketch that was asked for.

    Attributes
    ----------
    given : str
        As it was named.
    name : str
        Of its folder.
    sketch : Sketch or None
    problem : str
        Why there is none.
    """

    given: str
    name: str
    sketch: Sketch | None
    problem: str = ""


@dataclass(frozen=True)
class Item:
    """One terrain of a batch.

    Attributes
    ----------
    name : str
        Of its folder in the batch's, with slashes: ``valley_river/seed-007``. It follows from sketch, seed
        and settings alone.
    source : Source
    seed : int
        -1 where the sketch could not be read and no seed was given.
    settings : mapping of str to value
        In place of the sketch's.
    """

    name: str
    source: Source
    seed: int
    settings: Settings = field(default_factory=dict)

    @property
    def sketch(self) -> Sketch:
        """The sketch with its seed and settings.

        Raises
        ------
        InputError
            If it could not be read, or the settings do not fit together.
        """
        if self.source.sketch is None:
            raise InputError(self.source.problem)
        return with_settings(self.source.sketch.replace(seed=self.seed), self.settings)


def read_sources(given: Sequence[str]) -> tuple[Source, ...]:
    """Read sketches; one that can't be read stops no other one.

    Folders get the sketches' names; a name that is there already gets a number.

    Raises
    ------
    InputError
        If none is given, one is given twice, or none of them can be read.
    """
    if not given:
        raise InputError("expected a sketch, got none")
    twice = next((each for index, each in enumerate(given) if each in given[:index]), None)
    if twice is not None:
        raise InputError(f"sketch {twice} is given twice")
    names: list[str] = []
    sources: list[Source] = []
    for each in given:
        name = stem = _safe(Path(each).absolute().name.removesuffix(".sketch")) or "sketch"
        number = 2
        while name.casefold() in names:
            name, number = f"{stem}-{number}", number + 1
        names.append(name.casefold())
        try:
            sources.append(Source(each, name, load_sketch(each)))
        except SketchterrainError as error:
            sources.append(Source(each, name, None, str(error)))
    if all(source.sketch is None for source in sources):
        raise InputError(sources[0].problem)
    return tuple(sources)


def plan(
    sources: Sequence[Source], seeds: Sequence[int] = (), swept: Sequence[Swept] = ()
) -> tuple[Item, ...]:
    """Return every sketch with every seed and every combination of values, in that order.

    Parameters
    ----------
    sources
        From `read_sources`.
    seeds
        None: each sketch's own.
    swept
        Settings and their values.

    Raises
    ------
    InputError
        If there are more than `MOST_ITEMS`, a setting is there twice, or no sketch has what it is of.
    """
    names = [each.name for each in swept]
    twice = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if twice is not None:
        raise InputError(f"{twice} is set twice")
    readable = [source.sketch for source in sources if source.sketch is not None]
    for name in names:
        if not any(painted(sketch, name) for sketch in readable):
            layer, label, _ = name.split(".")
            raise InputError(f"{name}: no sketch of the batch has a label {label} in its layer {layer}")
    count = len(sources) * max(len(seeds), 1)
    for each in swept:
        count *= len(each.values)
    if count > MOST_ITEMS:
        raise InputError(f"{count} terrains: expected at most {MOST_ITEMS} in a batch")
    return tuple(
        _item(source, seed, dict(zip(names, values, strict=True)))
        for source in sources
        for values in product(*(each.values for each in swept))
        for seed in (seeds or (-1 if source.sketch is None else source.sketch.seed,))
    )


def _item(source: Source, seed: int, settings: Settings) -> Item:
    what = "_".join(f"{name}={_safe(_text(value))}" for name, value in settings.items())
    if len(what) > _LONGEST:
        what = f"{what[: _LONGEST - 9]}-{sha256(what.encode()).hexdigest()[:8]}"
    last = "seed-unknown" if seed < 0 else f"seed-{seed:03}"
    return Item("/".join(part for part in (source.name, what, last) if part), source, seed, settings)


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else number_text(value)


def _safe(name: str) -> str:
    """Return a name that is a folder's on every system: no separators, no spaces, not hidden."""
    return _UNSAFE.sub("_", name).lstrip(".-")[:_LONGEST]
