"""The process that places features: the newest sketch becomes a recipe of the terrain."""

from __future__ import annotations

import sys
import time
import traceback
from dataclasses import fields
from typing import TYPE_CHECKING, Final

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.ui.engine.channel import Channel, pickled
from sketchterrain.ui.engine.protocol import (
    Activity,
    ErrorReport,
    Placement,
    PlacementUnchanged,
    Plan,
    Quit,
    SketchUpdate,
)
from sketchterrain.ui.engine.sketch_updates import SketchMirror

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain import TerrainRecipe

SHORT: Final = 0.1
"""s; work that will probably be done sooner is finished in any case."""


class Superseded(Exception):  # noqa: N818 # nothing is wrong
    """There is a newer sketch to place."""


class CancellationPolicy:
    """Decides whether to go on placing when something newer waits.

    Whoever paints without a pause must see the terrain follow: of two attempts in a row one is finished, and
    so is what is more than half done, by what the last one took.
    """

    def __init__(self, newer: Callable[[], bool]) -> None:
        self._newer = newer
        self._usual = 0.0
        self._begun = 0.0
        self._given_up = False

    def begin(self) -> None:
        """Begin to place a sketch."""
        self._begun = time.monotonic()

    def checkpoint(self) -> None:
        """Go on, or raise."""
        spent = time.monotonic() - self._begun
        if self._given_up or spent > 0.5 * self._usual or self._usual - spent < SHORT:
            return
        if self._newer():
            self._given_up = True
            raise Superseded

    def end(self) -> float:
        """Remember how long it took; return it, s."""
        self._usual = time.monotonic() - self._begun
        self._given_up = False
        return self._usual


_LOOKS: Final = frozenset({"name", "weather", "look"})
"""Settings that change nothing of the terrain's shape."""
_LONG: Final = 0.3  # s, after which a person is told that something is being worked out


class Placer:
    """Follows the window's sketch, places it, and tells the window and the engine."""

    def __init__(self, window: Channel, engine: Channel) -> None:
        from sketchterrain.features.memory import PlacementCache

        self._window, self._engine = window, engine
        self._mirror = SketchMirror()
        self._memory = PlacementCache()
        self._patience = CancellationPolicy(self._newer)
        self._sketch: Sketch | None = None
        self._recipe: TerrainRecipe | None = None
        self._told = False

    def run(self) -> None:
        """Work until there is nothing more to do."""
        try:
            while self._take():
                if self._mirror.version >= 0:
                    self._work()
        except OSError:
            return  # the window is gone

    def _newer(self) -> bool:
        return self._window.has_message()

    def _take(self) -> bool:
        """Wait for an update and take over all that wait; return whether to go on."""
        try:
            while True:
                message = self._window.receive()
                if isinstance(message, Quit):
                    return False
                if isinstance(message, SketchUpdate):
                    self._mirror.apply(message)
                if not self._window.has_message():
                    return True
        except EOFError:
            return False

    def _work(self) -> None:
        try:
            sketch = self._mirror.sketch()
            if self._recipe is None or self._is_another(sketch):
                self._place(sketch)
            else:
                self._sketch = sketch
                now = time.monotonic()
                self._engine.send(Plan(self._mirror.changes(), None, (), now, now, now))
                self._window.send(PlacementUnchanged(self._mirror.version))
        except Superseded:
            pass
        except SketchterrainError as error:
            self._window.send(ErrorReport("sketch", one_line(error)))
        except OSError:
            raise
        except Exception as error:  # noqa: BLE001 # a defect must not end the program: the last terrain stays
            traceback.print_exc()
            line = one_line(f"the sketch could not be placed: {type(error).__name__}: {error}")
            self._window.send(ErrorReport("sketch", line))

    def _is_another(self, sketch: Sketch) -> bool:
        """Whether anything changed of what the terrain's shape depends on."""
        before = self._sketch
        if before is None or any(sketch.layers[name] is not before.layers[name] for name in sketch.layers):
            return True
        names = [each.name for each in fields(sketch) if each.name not in _LOOKS and each.name != "layers"]
        return any(getattr(sketch, name) != getattr(before, name) for name in names)

    def _place(self, sketch: Sketch) -> None:
        from sketchterrain.terrain.changes import EVERYWHERE, changed_areas
        from sketchterrain.terrain.from_sketch import make_recipe

        version = self._mirror.version
        self._patience.begin()
        self._begun = time.monotonic()
        try:
            recipe = make_recipe(sketch, memory=self._memory, checkpoint=self._checkpoint)
        finally:
            self._say_done()
        placed = time.monotonic()
        areas = [EVERYWHERE] if self._recipe is None else changed_areas(self._recipe, recipe)
        seconds = self._patience.end()
        data = pickled(recipe, but=sketch)
        self._engine.send(
            Plan(self._mirror.changes(), data, tuple(areas), self._begun, placed, time.monotonic())
        )
        self._sketch, self._recipe = sketch, recipe
        self._window.send(_placed(version, sketch, recipe, seconds))

    def _checkpoint(self) -> None:
        if not self._told and time.monotonic() - self._begun > _LONG:
            self._told = True
            self._window.send(Activity("Placing features"))
        self._patience.checkpoint()

    def _say_done(self) -> None:
        if self._told:
            self._told = False
            self._window.send(Activity(""))


def _placed(version: int, sketch: Sketch, recipe: TerrainRecipe, seconds: float) -> Placement:
    from sketchterrain.terrain.answers import TerrainFeatures

    found = TerrainFeatures.of(recipe, sketch.size)
    return Placement(
        version=version,
        points=found.points,
        rivers=found.rivers,
        lakes=found.lakes,
        resolutions=recipe.resolutions,
        orphans=recipe.orphans,
        seconds=seconds,
    )


def _main(window: int, engine: int) -> None:
    # Its updates may wait, but never hold up the placing.
    Placer(Channel.of(window), Channel.of(engine, patient=False)).run()


if __name__ == "__main__":
    _main(int(sys.argv[1]), int(sys.argv[2]))
