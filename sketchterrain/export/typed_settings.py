"""What to type in where files are imported, as rows that a person reads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from sketchterrain.export.sidecar import SIDECAR

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

__all__ = ["Row", "typed_rows"]

_MOST = 4  # entries of a list; the sidecar has all
_DIGITS = 10  # of a number that is shown


class Row(NamedTuple):
    """One thing to type in, or a heading over others.

    Attributes
    ----------
    depth : int
        0, or under so many headings.
    name, value : str
        A heading has no value.
    """

    depth: int
    name: str
    value: str


def typed_rows(settings: Mapping[str, Any]) -> list[Row]:
    """Return a target's settings (``import`` in the sidecar) as rows.

    >>> typed_rows({"Terrain Size": {"X": 3072.0, "Y": 450.55}, "Flip": False})
    [Row(depth=0, name='Terrain Size', value='X 3072  Y 450.55'), Row(depth=0, name='Flip', value='no')]
    """
    return list(_rows(settings, 0))


def _rows(settings: Mapping[str, Any], depth: int) -> Iterator[Row]:
    for name, value in settings.items():
        if isinstance(value, dict) and not all(isinstance(each, (int, float)) for each in value.values()):
            yield Row(depth, name, "")
            yield from _rows(value, depth + 1)
        elif isinstance(value, list) and any(isinstance(each, (dict, list)) for each in value):
            for number, entry in enumerate(value[:_MOST], start=1):
                yield Row(depth, name.removesuffix("s") + (f" {number}" if len(value) > 1 else ""), "")
                yield from _rows(entry, depth + 1)
            if len(value) > _MOST:
                yield Row(depth, name, f"{len(value) - _MOST} more in {SIDECAR}")
        else:
            yield Row(depth, name, _shown(value))


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return "  ".join(f"{name} {_shown(each)}" for name, each in value.items())
    if isinstance(value, list):
        return ", ".join(_shown(each) for each in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    return "none" if value is None else str(value)
