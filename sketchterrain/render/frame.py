"""The uniform block that all passes of a frame share: kernels/render/frame.glsl, laid out as std140."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.render.programs import FRAME_BINDING

if TYPE_CHECKING:
    import moderngl
    import numpy.typing as npt

NOISE_PERIOD: Final = 65_536.0
"""m; all noise that is looked up by place repeats after this, so the eye is given modulo it."""

_FRAME: Final = np.dtype(
    [
        ("to_clip", "f4", (4, 4)),
        ("from_clip", "f4", (4, 4)),
        ("eye", "f4", 4),
        ("to_sun", "f4", 4),
        ("sun_light", "f4", 4),
        ("sky_light", "f4", (9, 4)),
        ("haze", "f4", 4),
        ("air", "f4", 4),
        ("reach", "f4", 4),
        ("near_map", "f4", 4),
        ("far_map", "f4", 4),
        ("close_map", "f4", 4),
        ("near_window", "f4", 4),
        ("far_window", "f4", 4),
        ("close_window", "f4", 4),
        ("map_strength", "f4", 4),
        ("to_shade", "f4", (4, 4, 4)),
        ("shade_share", "f4", 4),
        ("trees", "f4", 4),
    ]
)


def wrap_to_noise_period(coordinate: float) -> float:
    """Return a coordinate (m) modulo `NOISE_PERIOD`, as near to 0 as it can be.

    Not all that is looked up by place fits the period, and so jumps where this does: far from any sketch, not
    at its western and southern border.
    """
    return math.remainder(coordinate, NOISE_PERIOD)


class FrameBlock:
    """Values of the block, by field name, and the buffer that holds them on the GPU."""

    def __init__(self, context: moderngl.Context) -> None:
        self._values = np.zeros((), _FRAME)
        self._buffer = context.buffer(reserve=_FRAME.itemsize)
        self._buffer.bind_to_uniform_block(FRAME_BINDING)

    def __setitem__(self, field: str, value: npt.ArrayLike) -> None:
        """Set a field; matrices are given row by row and fewer numbers than a field has leave its rest."""
        array = np.asarray(value, dtype=np.float64)
        target = self._values[field]
        if target.ndim >= 2 and target.shape[-2:] == (4, 4):
            target[...] = np.swapaxes(array, -1, -2)
        else:
            target[..., : array.shape[-1]] = array

    def __getitem__(self, field: str) -> npt.NDArray[np.float32]:
        """Return a copy of a field as it stands in the block."""
        return np.array(self._values[field])

    def upload(self) -> None:
        """Hand all fields to the GPU."""
        self._buffer.write(self._values.tobytes())
        self._buffer.bind_to_uniform_block(FRAME_BINDING)
