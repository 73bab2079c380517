"""Where and how large the materials' textures lie: what kernels/render/matter.glsl is told of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.look.texture_maker import LAYERS

OCTAVES: Final = 6
"""Sizes in which textures are laid."""
RATIO: Final = 3.7
"""Of one octave's width to the next."""
PERIOD: Final = 64
"""Textures after which the hexagons of kernels/render/hex_tiling.glsl come round."""
TURN: Final = 0.65
"""rad, of one octave against the next, where nothing has to lie level or along the wind."""
_PLANES: Final = ((1, 2), (0, 2), (0, 1))
_SUITED: Final = {
    "grass": (0, 2),
    "soil": (0, 3),
    "rock": (0, 5),
    "scree": (0, 2),
    "sand": (0, 2),
    "snow": (0, 3),
    "river_bed": (0, 1),
    "forest_floor": (0, 2),
    "canopy": (2, 2),
}
"""Finest and coarsest octave that a layer looks right in: blades of grass are never a metre wide."""
_ALIGNED: Final = {"rock": 0.0, "sand": 0.1, "snow": 0.2}
"""Layers with a direction of their own, and how far from it their hexagons may turn (rad)."""


def texture_widths(looks: Mapping[str, Mapping[str, Any]] | None = None) -> npt.NDArray[np.float64]:
    """Return the width (m) of each layer's texture at octave 0."""
    own = {name: layer.width for name, layer in LAYERS.items()}
    wanted = {name: look["size"] for name, look in (looks or {}).items() if look.get("size", 0.0) > 0.0}
    return np.array([{**own, **wanted}[name] for name in LAYERS])


def texture_uniforms(widths: npt.NDArray[np.float64]) -> dict[str, object]:
    """Return ``laid`` and ``spins`` of kernels/render/matter.glsl for layers of these widths (m)."""
    turns = _turns()
    laid = [
        (width, *_SUITED[name], turns[i]) for i, (name, width) in enumerate(zip(LAYERS, widths, strict=True))
    ]
    return {"laid": laid, "spins": [_ALIGNED.get(name, np.pi) for name in LAYERS]}


def texture_phases(eye: Sequence[float], widths: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """Say where the eye lies in the material textures.

    Computed in float64, so that textures stay put however far from the origin the eye is.
    """
    octave = np.arange(OCTAVES)
    angle = np.multiply.outer(_turns(), octave)[:, None, :]
    scale = 1.0 / np.multiply.outer(widths, RATIO**octave)[:, None, :]
    first, second = (np.array([eye[plane[k]] for plane in _PLANES])[:, None] for k in (0, 1))
    u = (np.cos(angle) * first - np.sin(angle) * second) * scale
    v = (np.sin(angle) * first + np.cos(angle) * second) * scale
    return (np.stack([u, v], axis=-1) % PERIOD).reshape(-1, 2).astype(np.float32)


def _turns() -> npt.NDArray[np.float64]:
    return np.array([0.0 if name in _ALIGNED else TURN for name in LAYERS])
