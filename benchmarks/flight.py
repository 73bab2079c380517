"""A flight over a world: screen error, triangles, generation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.benchmarks.flight_errors import at_one_pixel, points, reaching
from sketchterrain.benchmarks.flight_frames import frames
from sketchterrain.benchmarks.flight_generation import first_views, flights
from sketchterrain.benchmarks.flight_scene import open_world
from sketchterrain.benchmarks.flight_ways import OURS, THESIS
from sketchterrain.benchmarks.outcome import Outcome

if TYPE_CHECKING:
    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.outcome import Table
    from sketchterrain.benchmarks.timing import TimedContext


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Compare ways to choose triangles for views of a world, by screen error, triangles and time.

    The world is valley_river laid over 4096 m, the finest quads are not under 0.2 m; the camera flies 10 s at
    40 m/s along a circle, 4 to 120 m above the ground, and takes pictures of 1280 × 720 pixels, 45° high.

    Screen error: at places of the flight, rays through every fourth pixel both ways find the drawn triangles;
    the distance in pixels from what is seen to the terrain in full detail at the same x, y is the error. Full
    detail is more than 16 times the resolution of whatever is drawn, and the same for all. Ways are compared
    at the error that 99.9 % of the samples stay within. Triangles are those of tiles in view, borders to
    coarser tiles included; times are by the clock from nothing to the last tile in view, medians of views.
    The program's time covers the choice of tiles, coarser ones on the way, and all that its vertices carry.

    The thesis's metric (Zaaijer 2013, chapter 2): no quad longer than √d / (T · F), F = 2 near mountains and
    rivers and 1 elsewhere (the thesis tells no values), tiles across an edge one level apart. Its triangles
    stand on this terrain, its time is that of its own kernels, a launch of each a tile, without the choice
    and without what is prepared on the host. Uniform grid: one level, tiles out of view left out. pymartini
    and pydelatin: heightmaps of 257² samples two pixels apart at most, each thinned out to the height that so
    many pixels are at its nearest point; gaps between maps are left; time covers making and thinning them.

    Flights: each frame, this program generates what fits into 8 ms and morphs; the thesis's way generates at
    once what its metric asks for all around and was not there in the frame before. Milliseconds of generation
    by the clock: at the start, the mean of frames that generate, the worst, the mean of all. The first
    complete view: the time from nothing until all tiles are there, both with the T and the τ where they err
    by one pixel; kernels alone by profiling events.

    Frames as drawn: the renderer itself, at the quality that suits the driver, from a complete first picture
    on; the clock stops when OpenGL has finished.
    """
    terrain = open_world(context)
    errors = points(terrain, effort)
    generation = flights(terrain, effort)
    thesis, own = (_at_one_pixel_setting(errors, way) for way in (THESIS, OURS))
    drawn = frames(terrain, effort)
    first = first_views(context, terrain, effort, tessellation=thesis, tolerance=own)
    return Outcome((errors, generation, drawn, at_one_pixel(errors.rows), first))


def _at_one_pixel_setting(errors: Table, start: str) -> float | None:
    """Return what a way with its largest tiles is set to where it errs by one pixel, if known."""
    ways = [str(row["way"]) for row in errors.rows if str(row["way"]).startswith(start)]
    return reaching(errors.rows, ways[-1], "setting")
