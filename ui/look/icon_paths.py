"""Drawings as text: a short notation for lines, curves and circles on a grid, and its paths.

A drawing is words and numbers: ``M x y`` move, ``L x y`` line, ``C x y x y x y`` and ``Q x y x y`` curves,
``Z`` close, ``O x y r`` circle, ``R x y w h r`` rounded rectangle, ``A x y r from span`` arc (degrees, 0 is
east, on anticlockwise; it begins a part of its own). More pairs of numbers after ``M`` and ``L`` are lines.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from PyQt6.QtCore import QPointF, QRectF
from PyQt6.QtGui import QPainterPath

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["path_of"]

_WORD = re.compile(r"[A-Z]|-?[0-9.]+")


def path_of(drawing: str) -> QPainterPath:
    """Return the path that a drawing means.

    Raises
    ------
    ValueError
        If a word is unknown, or has the wrong number of numbers.
    """
    path = QPainterPath()
    word, numbers = "", list[float]()
    for part in [*_WORD.findall(drawing), ""]:
        if part and not part.isalpha():
            numbers.append(float(part))
            continue
        _add(path, word, numbers)
        word, numbers = part, []
    return path


def _add(path: QPainterPath, word: str, numbers: Sequence[float]) -> None:
    if not word and not numbers:
        return
    count, draw = _WORDS.get(word, (0, None))
    if draw is None or (len(numbers) % count if count else numbers) or (count and not numbers):
        raise ValueError(f"expected a word of a drawing and its numbers, got {word!r} {list(numbers)}")
    draw(path, numbers)


def _move(path: QPainterPath, at: Sequence[float]) -> None:
    path.moveTo(at[0], at[1])
    _line(path, at[2:])


def _line(path: QPainterPath, at: Sequence[float]) -> None:
    for x, y in zip(at[::2], at[1::2], strict=True):
        path.lineTo(x, y)


def _cubic(path: QPainterPath, at: Sequence[float]) -> None:
    for first in range(0, len(at), 6):
        path.cubicTo(*at[first : first + 6])


def _quadratic(path: QPainterPath, at: Sequence[float]) -> None:
    for first in range(0, len(at), 4):
        path.quadTo(*at[first : first + 4])


def _circle(path: QPainterPath, at: Sequence[float]) -> None:
    for x, y, radius in zip(at[::3], at[1::3], at[2::3], strict=True):
        path.addEllipse(QPointF(x, y), radius, radius)


def _rectangle(path: QPainterPath, at: Sequence[float]) -> None:
    x, y, width, height, radius = at
    path.addRoundedRect(QRectF(x, y, width, height), radius, radius)


def _arc(path: QPainterPath, at: Sequence[float]) -> None:
    x, y, radius, start, span = at
    around = QRectF(x - radius, y - radius, 2 * radius, 2 * radius)
    path.arcMoveTo(around, start)
    path.arcTo(around, start, span)


_WORDS: dict[str, tuple[int, Callable[[QPainterPath, Sequence[float]], None]]] = {
    "M": (2, _move),
    "L": (2, _line),
    "C": (6, _cubic),
    "Q": (4, _quadratic),
    "Z": (0, lambda path, _: path.closeSubpath()),
    "O": (3, _circle),
    "R": (5, _rectangle),
    "A": (5, _arc),
}
