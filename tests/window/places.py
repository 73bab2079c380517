"""Where things of the window are on the screen, and what it shows."""

from collections.abc import Callable

import numpy as np

from .person import Person

HANDLES = (
    "__import__('sketchterrain.ui.models.selection', fromlist=['handles_of'])"
    ".handles_of(window._link.placed, window._workspace.selection)"
)
_SHOWN = (
    "(lambda link: not link._timer.isActive() and None not in (link.frame, link.placed, link.relief) and "
    "link.frame.version == link.relief.version == link.placed.version == link._updates._version)"
    "(window._link)"
)


def on_canvas(person: Person) -> Callable[[float, float], tuple[float, float]]:
    """Return a function from pixels of the sketch to places of the screen."""
    left, top, scale, ratio, x, y = person.ask(
        "(lambda c, v, at: [v.left, v.top, v.scale, c.devicePixelRatioF(), at.x(), at.y()])"
        "(window.canvas, window.canvas.viewport, window.canvas.mapToGlobal(QPoint(0, 0)))"
    )
    return lambda column, row: (x + (left + column * scale) / ratio, y + (top + row * scale) / ratio)


def on_ground(person: Person) -> Callable[[float, float], tuple[float, float]]:
    """Return a function from metres east and north to places of the canvas on the screen."""
    at = on_canvas(person)
    size, rows = person.ask("[window._document.sketch.pixel_size, window._document.sketch.height_px]")
    return lambda east, north: at(east / size, rows - north / size)


def middle_of(person: Person, widget: str) -> tuple[float, float]:
    """Return where the middle of a widget is on the screen."""
    centre = f"{widget}.mapToGlobal({widget}.rect().center())"
    return tuple(person.ask(f"[{centre}.x(), {centre}.y()]"))


def view_of(person: Person, screen: np.ndarray) -> np.ndarray:
    x, y, width, height = person.ask(
        "[window.view.mapToGlobal(QPoint(0, 0)).x(), window.view.mapToGlobal(QPoint(0, 0)).y(), "
        "window.view.width(), window.view.height()]"
    )
    return screen[y : y + height, x : x + width].astype(int)


def wait_for_terrain(person: Person) -> None:
    """Wait until the newest sketch is what is placed, shown and lit."""
    person.wait(_SHOWN)
