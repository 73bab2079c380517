"""Previews on a thread of their own, which keeps OpenGL open: terrains wait for it, not for each other."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from sketchterrain.render.studio import Studio

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.render import Weather
    from sketchterrain.terrain import Terrain

__all__ = ["Previews"]


class Previews:
    """Takes previews, one at a time, in the order in which they are asked for."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="previews")
        self._studio: Studio | None = None

    def __enter__(self) -> Previews:
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.submit(self._close).result()
        self._thread.shutdown()

    def take(
        self,
        terrain: Terrain,
        *,
        view: str,
        weather: Weather,
        timings: dict[str, float],
        go_on: Callable[[], None],
    ) -> npt.NDArray[np.uint8]:
        """Return a picture as :func:`~sketchterrain.render.render_picture` does; any thread may ask.

        Parameters
        ----------
        terrain, view, weather, timings
        go_on
            Called when its turn has come; what it raises is raised here, and there is no picture.
        """
        return self._thread.submit(self._taken, terrain, view, weather, timings, go_on).result()

    def _taken(
        self,
        terrain: Terrain,
        view: str,
        weather: Weather,
        timings: dict[str, float],
        go_on: Callable[[], None],
    ) -> npt.NDArray[np.uint8]:
        go_on()
        if self._studio is None:
            self._studio = Studio()
        return self._studio.picture(terrain, view=view, weather=weather, timings=timings)

    def _close(self) -> None:
        if self._studio is not None:
            self._studio.close()
            self._studio = None
