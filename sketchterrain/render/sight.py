"""Where a line of sight meets the ground: what is under the mouse, where to jump to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.render.camera import Ground, Vector

_SAMPLES: Final = 256
_ROUNDS: Final = 4
_NEAREST: Final = 0.5  # m


def sight(ground: Ground, eye: Vector, along: npt.ArrayLike, *, reach: float) -> Vector | None:
    """Return the first point where a line of sight goes into the ground, None if it does not.

    Ridges that are narrower than a hundredth of their distance can be missed.
    """
    start, way = np.asarray(eye, np.float64), np.asarray(along, np.float64)
    far = np.concatenate([[0.0], np.geomspace(_NEAREST, reach, _SAMPLES - 1)])
    for _ in range(_ROUNDS):
        places = start + far[:, None] * way
        below = places[:, 2] < np.asarray(ground(places[:, 0], places[:, 1]), np.float64)
        if not below.any():
            return None
        first = int(np.argmax(below))
        if first == 0:
            break
        far = np.linspace(far[first - 1], far[first], _SAMPLES)
    x, y, z = (start + far[first] * way).tolist()
    return x, y, z
