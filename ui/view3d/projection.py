"""Where places of the world are seen in a picture, and what a place of the picture looks at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from sketchterrain.ui.engine.messages import FrameFacts

__all__ = ["Projection", "Seen"]

Floats = npt.NDArray[np.float64]

_NEAREST = 1e-3  # of the clip space's w (m before the eye) that counts as seen
_FLATTEST = 0.02  # slope of a line of sight below which it meets no level plane


@dataclass(frozen=True, eq=False)
class Seen:
    """Places as they are seen.

    Attributes
    ----------
    at : (n, 2) float64
        Where, in px from the widget's upper left corner; of what is behind the eye nothing useful.
    away : (n,) float64
        m before the eye; what is not before it has 0 or less.
    """

    at: Floats
    away: Floats

    @property
    def before(self) -> npt.NDArray[np.bool_]:
        """Which ones lie before the eye."""
        return np.asarray(self.away > _NEAREST)


class Projection:
    """A picture's camera, for the place where the picture is shown.

    Parameters
    ----------
    frame
        The picture's.
    place
        Left, top, width and height (px of the widget) of where the picture is shown.
    """

    def __init__(self, frame: FrameFacts, place: tuple[float, float, float, float]) -> None:
        self.eye: Floats = np.array(frame.pose.eye, np.float64)
        self.place = place
        self._clip: Floats = np.array(frame.to_clip, np.float64).reshape(4, 4)
        self._back = np.asarray(np.linalg.inv(self._clip), np.float64)

    def see(self, places: npt.ArrayLike) -> Seen:
        """Return where places (n, 3) in m are seen."""
        off = np.atleast_2d(np.asarray(places, np.float64)) - self.eye
        clip = off @ self._clip[:, :3].T + self._clip[:, 3]
        away = clip[:, 3]
        safe = np.where(np.abs(away) > _NEAREST, away, _NEAREST)
        left, top, width, height = self.place
        at = np.stack(
            [
                left + 0.5 * width * (1.0 + clip[:, 0] / safe),
                top + 0.5 * height * (1.0 - clip[:, 1] / safe),
            ],
            axis=-1,
        )
        return Seen(at, np.asarray(away))

    def ray(self, x: float, y: float) -> Floats:
        """Return the unit vector along which a place (px of the widget) is seen."""
        left, top, width, height = self.place
        across, up = 2.0 * (x - left) / width - 1.0, 1.0 - 2.0 * (y - top) / height
        near, far = (self._back @ [across, up, depth, 1.0] for depth in (-1.0, 1.0))
        along = far[:3] / far[3] - near[:3] / near[3]
        return np.asarray(along / np.linalg.norm(along))

    def on_level(self, x: float, y: float, z: float) -> tuple[float, float] | None:
        """Return where (m) a line of sight meets the level plane at a height (m); None if nowhere or far off.

        Parameters
        ----------
        x, y
            px of the widget.
        z
            m.
        """
        along = self.ray(x, y)
        rise = z - float(self.eye[2])
        if abs(along[2]) < _FLATTEST or rise * along[2] <= 0.0:
            return None
        east, north = self.eye[:2] + along[:2] * (rise / along[2])
        return float(east), float(north)

    def share(self, x: float, y: float) -> tuple[float, float]:
        """Return a place of the widget (px) as shares of the picture from its upper left corner."""
        left, top, width, height = self.place
        return (x - left) / width, (y - top) / height

    def metres_per_px(self, place: npt.ArrayLike) -> float:
        """Return how many metres across a px of the widget is at a place (m); 0 behind the eye."""
        seen = self.see(place)
        _, _, _, height = self.place
        # The second row of the matrix is the upward axis over tan(fov / 2).
        scale = float(np.linalg.norm(self._clip[1, :3]))
        return max(2.0 * float(seen.away[0]) / (scale * height), 0.0)

    def runs(self, places: npt.ArrayLike) -> list[tuple[int, Floats]]:
        """Return the parts of a line (n, 3) that lie before the eye, as px (m, 2), cut where they pass it.

        Returns
        -------
        list of (first, (m, 2) float64)
            The index of the first of the part's whole points, and the part.
        """
        line = np.asarray(places, np.float64)
        seen = self.see(line)
        inside = seen.before
        if inside.all():
            return [(0, seen.at)] if len(line) > 1 else []
        found = []
        turns = np.flatnonzero(np.diff(inside)) + 1
        for first, end in zip([0, *turns], [*turns, len(line)], strict=True):
            if not inside[first]:
                continue
            part = [seen.at[first:end]]
            if first > 0:
                part.insert(0, self._cut(line, seen.away, int(first), int(first) - 1))
            if end < len(line):
                part.append(self._cut(line, seen.away, int(end) - 1, int(end)))
            together = np.concatenate(part)
            if len(together) > 1:
                found.append((int(first), together))
        return found

    def _cut(self, line: Floats, away: Floats, seen: int, unseen: int) -> Floats:
        """Return where a piece of a line passes just before the eye, (1, 2)."""
        near = 1e-3 * float(away[seen]) + 2.0 * _NEAREST
        share = (away[seen] - near) / (away[seen] - away[unseen])
        return self.see((line[seen] + max(share, 0.0) * (line[unseen] - line[seen]))[None]).at
