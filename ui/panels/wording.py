"""A parameter in words for a person: its title, unit and help, and values that mean something else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from sketchterrain.sketch import LAYERS, Parameter
from sketchterrain.sketch.parameter import format_number


@dataclass(frozen=True)
class Special:
    """A value of a parameter that is no number to a person.

    Attributes
    ----------
    value : float
        As it stands in the sketch.
    title : str
        What it means.
    start : float
        The number to begin with where a person wants one.
    low, high : float
        Numbers that a slider offers beside it.
    """

    value: float
    title: str
    start: float
    low: float
    high: float


_SPECIALS: Final = {
    "flow": Special(-1.0, "Downhill", 180.0, 0.0, 360.0),
    "conifers": Special(-1.0, "By elevation", 0.5, 0.0, 1.0),
    "quality": Special(-1.0, "Automatic", 0.5, 0.0, 1.0),
    "hour": Special(-1.0, "Best light", 12.0, 0.0, 24.0),
    "width": Special(0.0, "As wide as painted", 12.0, 0.5, 2000.0),
    "snow_line": Special(1e4, "No snow", 2000.0, 0.0, 5000.0),
    "tree_line": Special(1e4, "No limit", 1800.0, 0.0, 5000.0),
}

_COMFORTABLE: Final = {"extent": (128.0, 262144.0), "x": (0.0, 4096.0), "y": (0.0, 4096.0)}
"""What sliders offer where the declaration allows far more; the number beside them takes all."""


def drag_title(name: str) -> str:
    """Return a key of the file as words: ``"Snow line"``."""
    return name.replace("_", " ").capitalize()


def special_of(parameter: Parameter) -> Special | None:
    """Return the value of a parameter that is no number to a person, if it has one."""
    special = _SPECIALS.get(parameter.name)
    return special if special and special.value in (parameter.low, parameter.high) else None


def comfortable_range(parameter: Parameter) -> tuple[float, float]:
    """Return the least and the greatest value that a slider offers."""
    special = special_of(parameter)
    if special is not None:
        return special.low, special.high
    return _COMFORTABLE.get(parameter.name, (parameter.low, parameter.high))


def help_of(parameter: Parameter) -> str:
    """Return the line of help, without the words on a special value, for which there is a box to check."""
    special = special_of(parameter)
    text = parameter.help
    if special is not None:
        mark = f"{format_number(special.value)} "
        text = "; ".join(part for part in text.split("; ") if not part.startswith(mark))
    return text[:1].upper() + text[1:]


def suffix_of(parameter: Parameter) -> str:
    """Return what stands behind a number: its unit."""
    unit = parameter.unit.removeprefix("1")
    if not unit or parameter.kind is str:
        return ""
    return unit if unit == "°" else f" {unit}"


def number(value: float, *, decimals: int = 3) -> str:
    """Return a number as a person writes it, with few decimals: 600, 0.5, 12.25."""
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text in ("-0", "") else text.replace("-", "−")


def with_unit(parameter: Parameter, value: float | str) -> str:
    """Return a value in words: ``"600 m"``, ``"downhill"``, ``"rock"``."""
    if isinstance(value, str):
        return value.replace("_", " ")
    special = special_of(parameter)
    if special is not None and value == special.value:
        return special.title.lower()
    return number(value, decimals=2) + suffix_of(parameter)


def tool_tip(parameter: Parameter) -> str:
    """Return what a pointer that rests on a parameter is told: help, range and default."""
    lines = [help_of(parameter) + "."]
    if parameter.kind is not str:
        lines.append(f"{parameter.expected[:1].upper()}{parameter.expected[1:]}.")
    if parameter.default != "":
        lines.append(f"Default: {with_unit(parameter, parameter.default)}.")
    return "\n".join(lines)


def size_text(size: float) -> str:
    """Return a number of bytes in words: ``"812 MB"``."""
    for unit in ("kB", "MB"):
        size /= 1000
        if size < 1000:
            return f"{number(size, decimals=0 if size >= 10 else 1)} {unit}"
    return f"{number(size / 1000, decimals=2)} GB"


def label_title(layer: str, label: int) -> str:
    """Return what a label is called: ``"Mountains 2"``."""
    return f"{LAYERS[layer].title} {label}"
