"""Stage 2 (Zaaijer 2013 §4.3-4.4): every user feature finds its final place.

At fidelity 1 that is where it was painted. Below, it looks around and takes the place that it prefers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.features.catalogue import FEATURE, FEATURE_TYPES, Points, conifer_code
from sketchterrain.features.density import DensityField, cubic
from sketchterrain.features.hashing import unit
from sketchterrain.features.memory import ShapeMemory
from sketchterrain.features.profiles import shown_at
from sketchterrain.features.rules import PREFERENCES, SUMMIT_SHUNS_SUMMIT, TYPES, Preference

if TYPE_CHECKING:
    from sketchterrain.sketch.document import Sketch

LOOSENESS = 0.5
"""How far a feature may move at fidelity 0, in radii of its disc."""

_PLACES = 8  # places that a feature compares; the first is where it was painted
_LEAST_RADIUS = 1.5  # px
_LEAST_SHARE = 0.36  # of its label's strength: a lower feature does not reach farther for being low

Floats = npt.NDArray[np.float64]


def place(sketch: Sketch, *, seed: int, memory: ShapeMemory | None = None) -> Points:
    """Place the features of everything that was painted, rivers apart.

    Parameters
    ----------
    sketch : Sketch
        The document; its own seed is not looked at.
    seed : int
        Seed of the terrain.
    memory : ShapeMemory, optional
        From the last time, so that only what was painted since is broken up anew. The result is the same.

    Returns
    -------
    Array of ``FEATURE``, sorted by id. Every painted shape has at least one. Nothing painted farther away
    than two of a feature's discs changes it.
    """
    memory = ShapeMemory() if memory is None else memory
    users = {name: memory.user_features(sketch, name, seed=seed) for name in FEATURE_TYPES}
    placed: dict[str, Points] = {}
    around = _Around(sketch, users, placed, memory)
    for name in TYPES:
        positions = _painted_positions(sketch, users[name])
        if sketch.fidelity < 1.0 and len(positions):
            positions = _preferred(around, name, seed)
        placed[name] = _features(sketch, name, users[name], positions)
    everything = np.concatenate(list(placed.values()))
    ordered: Points = everything[np.argsort(everything["id"], kind="stable")]
    return ordered


def _painted_positions(sketch: Sketch, users: npt.NDArray[np.void]) -> Floats:
    x = (users["column"] + 0.5) * sketch.pixel_size
    y = (sketch.height_px - users["row"] - 0.5) * sketch.pixel_size
    return np.stack([x, y], axis=-1)


class _Around:
    """What a place can be judged by: user features, what is already placed, painted pixels."""

    def __init__(
        self,
        sketch: Sketch,
        users: dict[str, npt.NDArray[np.void]],
        placed: dict[str, Points],
        memory: ShapeMemory,
    ) -> None:
        self.sketch = sketch
        self.users = users
        self._placed = placed
        self._memory = memory

    def presence(self, preference: Preference, at: Floats, disc: Floats) -> Floats:
        """How much of what a preference names is near each place: about 1 for one thing of like size."""
        reach = preference.reach * disc
        if preference.what == "layer":
            return cubic(
                self._memory.painted_distance(self.sketch, preference.of)(at[:, 0], at[:, 1]) / reach
            )
        if preference.what == "user":
            others = self.users[preference.of]
            positions = _painted_positions(self.sketch, others)
            sizes = others["disc"] * self.sketch.pixel_size
        else:
            final = self._placed[preference.of]
            positions = np.stack([final["x"], final["y"]], axis=-1)
            sizes = final["radius"].astype(np.float64)
        return DensityField(positions, sizes).total(at, reach) / disc


def _preferred(around: _Around, name: str, seed: int) -> Floats:
    own = around.users[name]
    painted = _painted_positions(around.sketch, own)
    disc = own["disc"] * around.sketch.pixel_size
    number = np.arange(_PLACES)
    ids = own["id"].astype(np.uint64)[:, None]
    angle = 2.0 * np.pi * unit(seed, "place angle", ids, number)
    distance = np.sqrt(unit(seed, "place distance", ids, number)) * (number > 0)
    distance *= LOOSENESS * (1.0 - around.sketch.fidelity) * disc[:, None]
    places = painted[:, None, :] + np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)

    at, radius = places.reshape(-1, 2), np.repeat(disc, _PLACES)
    score = np.zeros(len(at))
    for preference in PREFERENCES:
        if preference.feature == name:
            score += preference.weight * around.presence(preference, at, radius)
    score = score.reshape(-1, _PLACES) + SUMMIT_SHUNS_SUMMIT * _other_summits(own, painted, disc, places)
    best = np.argmax(score, axis=1)
    return np.asarray(places[np.arange(len(own)), best])


def _other_summits(own: npt.NDArray[np.void], painted: Floats, disc: Floats, places: Floats) -> Floats:
    """Density of the other summits of this type, as painted, at each place; 0 for support."""
    summit = np.flatnonzero(own["summit"])
    field = DensityField(painted[summit], disc[summit])
    at, reach = places[summit].reshape(-1, 2), np.repeat(2.0 * disc[summit], _PLACES)
    around = field.total(at, reach).reshape(-1, _PLACES) / disc[summit][:, None]
    itself = np.hypot(*np.moveaxis(places[summit] - painted[summit][:, None], -1, 0))
    result = np.zeros(places.shape[:2])
    result[summit] = around - cubic(itself / (2.0 * disc[summit][:, None]))
    return result


def _features(sketch: Sketch, name: str, users: npt.NDArray[np.void], positions: Floats) -> Points:
    rule = TYPES[name]
    disc = users["disc"] * sketch.pixel_size
    result = np.zeros(len(users), dtype=FEATURE)
    result["id"], result["type"], result["painted"] = users["id"], users["type"], True
    result["x"], result["y"] = positions[:, 0], positions[:, 1]
    for label in np.unique(users["label"]):
        of_label = users["label"] == label
        properties = sketch.properties(name, int(label))
        strength = properties["density" if name == "forest" else "height"] * users["share"][of_label]
        result["strength"][of_label] = np.minimum(strength, rule.most_slope * disc[of_label])
        for field in ("peakiness", "wavelength", "wind"):
            result[field][of_label] = properties.get(field, 0.0)
        if name == "forest":
            result["peakiness"][of_label] = conifer_code(float(properties["conifers"]))
    if name != "forest":
        # A ridge between summits has no tips of its own.
        result["peakiness"][~users["summit"]] = 0.0
    share = np.maximum(users["share"], _LEAST_SHARE)
    shown = shown_at(name, share, result["peakiness"].astype(np.float64), sketch.fidelity)
    result["radius"] = np.maximum(disc * rule.reach / shown, _LEAST_RADIUS * sketch.pixel_size)
    if name == "forest":
        result["strength"] = np.minimum(result["strength"], 1.0)
    return result
