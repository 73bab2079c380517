"""The placer process: turns the newest sketch into a terrain recipe for the engine."""

from __future__ import annotations

import gc
import math
import sys
import time
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.jobs.estimates import time_left
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.channel import Channel, ContentChannel

if TYPE_CHECKING:
    from sketchterrain.stages.table import Evaluation
    from sketchterrain.terrain.recipe import TerrainRecipe

_DRAFT_AFTER: Final = 0.2  # s; a placement expected to take longer is shown as a draft first
_SLOW: Final = 0.8  # s; ... at the end of a stroke too
_SHORT: Final = 0.1  # s; a placement expected to end sooner is finished in any case
_FADING: Final = 0.8  # of the slowest placement, by the next one that changes the natural ground
_REST: Final = 0.06  # s without a newer sketch, after which a draft is followed by the final terrain


class Superseded(Exception):  # noqa: N818 # not an error
    """A newer sketch is waiting."""


class CancellationPolicy:
    """Decides whether to cancel a placement when a newer sketch is waiting.

    The terrain must follow a long stroke: of two attempts in a row one is finished, and so is any placement
    that is more than half done, judged by the duration of the last one.
    """

    def __init__(self, is_superseded: Callable[[], bool]) -> None:
        self._is_superseded = is_superseded
        self._expected = self._slowest = 0.0
        self._started = 0.0
        self._cancelled_last = False

    def start(self) -> None:
        """Note the start of a placement."""
        self._started = time.monotonic()

    def checkpoint(self) -> None:
        """Return, or raise `Superseded`."""
        spent = time.monotonic() - self._started
        if self._cancelled_last or spent > 0.5 * self._expected or self._expected - spent < _SHORT:
            return
        if self._is_superseded():
            self._cancelled_last = True
            raise Superseded

    @property
    def shows_drafts(self) -> bool:
        """Whether placements may take long enough for a draft, whatever the last one took."""
        return max(self._expected, self._slowest) > _DRAFT_AFTER

    @property
    def is_slow(self) -> bool:
        """Whether to draft the end of a stroke too: it delays the view of the final terrain."""
        return self._slowest > _SLOW

    def drafted(self) -> None:
        """Note that a draft is shown: from now on any newer sketch cancels the placement."""
        self._expected, self._cancelled_last = math.inf, False

    def finish(self, *, shapes: bool) -> float:
        """Record and return the duration of the finished placement, s; `shapes`: of other natural ground."""
        self._expected = time.monotonic() - self._started
        self._slowest = max(self._expected, (_FADING if shapes else 1.0) * self._slowest)
        self._cancelled_last = False
        return self._expected


_REPORT_AFTER: Final = 0.3  # s, after which the window shows that features are being placed


def place_of_finding(sketch: Sketch, line: str) -> tuple[float, float] | None:
    """Return the middle vertex (m) of the vector that a finding begins with, as ``road 12: …``; else None."""
    layer, name, *_ = [*line.replace(":", " ").split(), "", ""]
    vectors = sketch.vectors.get(layer)
    if vectors is None or not name.isdecimal() or int(name) not in vectors:
        return None
    (ring, *_) = vectors.feature(int(name)).rings
    x, y = ring[len(ring) // 2].tolist()
    return x, y


class Placer:
    """Follows the window's sketch, places it, and reports to the window and the engine."""

    def __init__(self, window: Channel, engine: Channel) -> None:
        from sketchterrain.stages.runner import Results

        self._window, self._engine = window, engine
        self._newest: msg.SketchUpdate | None = None
        self._memory = Results()
        self._policy = CancellationPolicy(window.has_message)
        self._last: Evaluation | None = None
        self._reported = False
        self._started = 0.0

    def run(self) -> None:
        """Serve until `Quit`, or until the window has ended."""
        try:
            while self._receive():
                if self._newest is not None:
                    self._update(self._newest)
        except (EOFError, OSError):
            return

    def _receive(self) -> bool:
        """Wait for an update and apply all pending ones; return False for `Quit`."""
        while True:
            message = self._window.receive()
            if isinstance(message, msg.Quit):
                return False
            if isinstance(message, msg.SketchUpdate):
                self._newest = message
            if not self._window.has_message():
                return True

    def _update(self, update: msg.SketchUpdate) -> None:
        try:
            self._place(update.version, update.sketch)
        except Superseded:
            pass
        except SketchterrainError as error:
            self._window.send(msg.ErrorReport("sketch", one_line(error)))
        except OSError:
            raise
        except Exception as error:  # noqa: BLE001 # a defect must not end the program: the last terrain stays
            traceback.print_exc()
            line = one_line(f"the sketch could not be placed: {type(error).__name__}: {error}")
            self._window.send(msg.ErrorReport("sketch", line))

    def _place(self, version: int, sketch: Sketch) -> None:
        from sketchterrain.generation.building import draft_recipes, evaluation
        from sketchterrain.terrain.surfaces import TerrainFeatures

        self._policy.start()
        self._started = started = time.monotonic()
        try:
            stages = evaluation(sketch, self._memory, self._checkpoint, self._show_share)
            if self._policy.shows_drafts and self._last is not None:
                rest = _REST
                for draft in draft_recipes(stages, self._last):
                    drafted = time.monotonic()
                    if self._window.has_message(rest) or self._policy.is_slow:
                        self._engine.send(
                            msg.RecipeUpdate(version, sketch, draft, started, drafted, draft=True)
                        )
                        self._policy.drafted()
                    self._checkpoint()  # while the stroke goes on, the next draft comes first
                    rest = 0.0
            recipe: TerrainRecipe = stages["recipe"]
        finally:
            if self._reported:
                self._reported = False
                self._window.send(msg.Activity(""))
        placed = time.monotonic()
        before, self._last = self._last, stages
        if before is not None and recipe is before["recipe"]:
            self._engine.send(msg.RecipeUpdate(version, sketch, None, placed, placed))
            self._window.send(msg.Unchanged("placement", version))
            return
        self._engine.send(msg.RecipeUpdate(version, sketch, recipe, started, placed))
        found = TerrainFeatures.from_recipe(recipe, sketch.size)
        self._window.send(
            msg.Placement(
                version=version,
                points=found.points,
                rivers=found.rivers,
                lakes=found.lakes,
                resolutions=recipe.resolutions,
                roads=recipe.network.roads,
                findings=tuple((line, place_of_finding(sketch, line)) for line in recipe.network.findings),
                orphans=recipe.orphans,
                seconds=self._policy.finish(
                    shapes=before is None or stages["surface"] is not before["surface"]
                ),
            )
        )

    def _checkpoint(self) -> None:
        if not self._reported and time.monotonic() - self._started > _REPORT_AFTER:
            self._reported = True
            self._window.send(msg.Activity("Placing features"))
        self._policy.checkpoint()

    def _show_share(self, share: float) -> None:
        left = time_left(share, time.monotonic() - self._started)
        if left:
            self._reported = True
            self._window.send(msg.Activity(f"Placing features: {share:.0%}, {left}"))


if __name__ == "__main__":
    gc.set_threshold(*gc.get_threshold()[:2], 100)  # collecting all garbage takes as long as placing
    # Recipes may queue, but must never delay placement.
    _window, _engine = (int(each) for each in sys.argv[1:])
    Placer(
        ContentChannel.from_descriptor(_window), ContentChannel.from_descriptor(_engine, patient=False)
    ).run()
