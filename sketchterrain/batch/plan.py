"""The terrains of a batch: each sketch with each seed and each combination of settings."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from itertools import product
from math import prod
from pathlib import Path
from typing import Final

from sketchterrain.batch.settings import Settings, Swept, applies_to, with_settings
from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.sketch import Sketch, load_sketch
from sketchterrain.sketch.parameter import format_number

MOST_ITEMS: Final = 10_000  # the manifest is written after each
_LONGEST: Final = 120  # characters of a folder's name
_UNSAFE = re.compile(r"[^\w.=+-]", re.ASCII)


@dataclass(frozen=True)
class Source:
    """A sketch as it was named, the name of its folder, and why it could not be read."""

    given: str
    name: str
    sketch: Sketch | None
    problem: str = ""


@dataclass(frozen=True)
class Item:
    """One terrain of a batch; its folder ``valley_river/seed-007`` follows from sketch, seed and settings."""

    name: str
    source: Source
    seed: int
    settings: Settings = field(default_factory=dict)

    @property
    def sketch(self) -> Sketch:
        """The sketch with its seed and settings; raise InputError if it could not be read."""
        if self.source.sketch is None:
            raise InputError(self.source.problem)
        return with_settings(self.source.sketch.replace(seed=self.seed), self.settings)


def read_sources(given: Sequence[str]) -> tuple[Source, ...]:
    """Read sketches; raise InputError for none, for one given twice, or if none of them can be read."""
    if not given:
        raise InputError("expected a sketch, got none")
    twice = next((each for index, each in enumerate(given) if each in given[:index]), None)
    if twice is not None:
        raise InputError(f"sketch {twice} is given twice")
    names: set[str] = set()
    sources: list[Source] = []
    for each in given:
        name = stem = _safe(Path(each).absolute().name.removesuffix(".sketch")) or "sketch"
        number = 2
        while name.casefold() in names:
            name, number = f"{stem}-{number}", number + 1
        names.add(name.casefold())
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
    """Return every sketch with every combination of values and every seed, by default its own.

    Raise InputError for more than `MOST_ITEMS`, or a setting that no sketch has.
    """
    names = [each.name for each in swept]
    if len({*names}) < len(names):
        raise InputError(f"a setting is set twice: {', '.join(names)}")
    for name in names:
        if not any(source.sketch is not None and applies_to(source.sketch, name) for source in sources):
            layer, label, _ = name.split(".")
            raise InputError(f"{name}: no sketch of the batch has a label {label} in its layer {layer}")
    count = len(sources) * max(len(seeds), 1) * prod(len(each.values) for each in swept)
    if count > MOST_ITEMS:
        raise InputError(f"{count} terrains: expected at most {MOST_ITEMS} in a batch")
    return tuple(
        _item(source, seed, dict(zip(names, values, strict=True)))
        for source in sources
        for values in product(*(each.values for each in swept))
        for seed in (seeds or (-1 if source.sketch is None else source.sketch.seed,))
    )


def _item(source: Source, seed: int, settings: Settings) -> Item:
    texts = {
        name: value if isinstance(value, str) else format_number(value) for name, value in settings.items()
    }
    what = "_".join(f"{name}={_safe(text)}" for name, text in texts.items())
    if len(what) > _LONGEST:
        what = f"{what[: _LONGEST - 9]}-{sha256(what.encode()).hexdigest()[:8]}"
    last = "seed-unknown" if seed < 0 else f"seed-{seed:03}"  # of a sketch that could not be read
    return Item("/".join(part for part in (source.name, what, last) if part), source, seed, settings)


def _safe(name: str) -> str:
    """Return a folder name that is valid on every system: no separators, no spaces, not hidden."""
    return _UNSAFE.sub("_", name).lstrip(".-")[:_LONGEST]
