"""The recipe: an immutable value of everything that a terrain's heights depend on."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from sketchterrain.array_types import StructuredArray
from sketchterrain.document.material_rules import DEFAULT_RULES, MaterialRule
from sketchterrain.document.materials import BUILT_IN, MaterialTable
from sketchterrain.placement.feature_types import (
    BY_ELEVATION,
    FEATURE_TYPES,
    Cover,
    Lake,
    River,
    conifer_share,
    flank,
)
from sketchterrain.terrain.noise import FINEST_WAVELENGTH, NoiseStack

if TYPE_CHECKING:
    from sketchterrain.hydrology.conflicts import Resolution

FINEST_CELL = FINEST_WAVELENGTH / 4
"""Cell size that resolves every octave, m; finer ones give the same terrain."""

# Noises must not depend on placed features: an edit in one corner would reshape the whole world.
_RIDGE_SHARE = 1 / 8  # of the extent: nearly the width of a typical mountain
_CREST_SHARE = 1 / 8  # of the extent: wavelength of the crests of dunes
_MAX_CREST = 1260.0  # m


class FeatureSource(Protocol):
    """Features of unpainted areas: a pure function of the position."""

    @property
    def max_radius(self) -> float:
        """Radius that no feature exceeds, m; 0 if there are none."""
        ...

    def within(
        self, west: float, south: float, east: float, north: float, *, min_radius: float = 0.0
    ) -> StructuredArray:
        """Return the features whose centre lies in the rectangle (m), sorted by id."""
        ...


@dataclass(frozen=True, eq=False)
class TerrainRecipe:
    """A terrain as a value: the same recipe gives the same heights wherever and however it is evaluated.

    Attributes
    ----------
    extent : float
        Metres along the sketch's longer side.
    seed : int
    fidelity : float
        0 … 1; outlines deviate less towards 1.
    ground, climate : mapping
        The sketch's [ground] and [climate] parameters.
    painted : structured ndarray
        Placed features (dtype ``FEATURE``), sorted by id.
    fill : FeatureSource
        Features of unpainted areas.
    rivers : tuple of River
    valley_radii : tuple of ndarray
        For each river its valley's radius of influence at each point of the centreline, m.
    lakes : tuple of Lake
    covers : tuple of Cover
        Painted materials, later ones on top.
    materials : MaterialTable
        Materials that rules and covers name.
    material_rules : tuple of MaterialRule
        Rules for materials under the painted ones, from bottom to top.
    resolutions : tuple of Resolution
        Decisions where layers contradict each other, one line and a position each.
    orphans : tuple of str
        Edits of features that no longer exist, one line each.
    """

    extent: float
    seed: int
    fidelity: float
    ground: Mapping[str, float]
    climate: Mapping[str, float]
    painted: StructuredArray
    fill: FeatureSource
    rivers: tuple[River, ...] = ()
    valley_radii: tuple[np.ndarray[tuple[int], np.dtype[np.float64]], ...] = ()
    lakes: tuple[Lake, ...] = ()
    covers: tuple[Cover, ...] = ()
    materials: MaterialTable = BUILT_IN
    material_rules: tuple[MaterialRule, ...] = DEFAULT_RULES
    resolutions: tuple[Resolution, ...] = ()
    orphans: tuple[str, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields with plain dicts, without cached properties."""
        state = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        return state | {key: dict(state[key]) for key in ("ground", "climate")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the fields."""
        for key, value in state.items():
            object.__setattr__(self, key, MappingProxyType(value) if isinstance(value, dict) else value)

    @property
    def warp(self) -> float:
        """Greatest displacement of features' outlines, in radii."""
        return 0.34 - 0.2 * self.fidelity - 0.5 * max(self.fidelity - 0.8, 0.0)

    @property
    def ridge_depth(self) -> float:
        """Greatest share of its height that a mountain gains or loses by noise."""
        return 0.9 - 1.7 * max(self.fidelity - 0.8, 0.0)

    @property
    def flank(self) -> float:
        """Exponent by which the flanks of mountains and hills are steeper than at a low fidelity."""
        return flank(self.fidelity)

    @property
    def ridge_wavelength(self) -> float:
        """Wavelength of the mountains' main ridges, m."""
        return self.extent * _RIDGE_SHARE

    @cached_property
    def dune_styles(self) -> tuple[tuple[float, float], ...]:
        """Distinct (wavelength in m, wind in degrees) of the dunes, sorted."""
        dunes = self.painted[self.painted["type"] == FEATURE_TYPES.index("dune")]
        painted = {(float(dune["wavelength"]), float(dune["wind"])) for dune in dunes}
        return tuple(sorted(painted | set(getattr(self.fill, "dune_styles", ()))))

    @cached_property
    def has_conifer_shares(self) -> bool:
        """Whether any forest's share of conifers is set instead of derived from elevation."""
        forests = self.painted[self.painted["type"] == FEATURE_TYPES.index("forest")]
        shares = (*conifer_share(forests["peakiness"]), getattr(self.fill, "conifers", BY_ELEVATION))
        return bool(max(shares) >= 0.0)

    @property
    def stacks(self) -> tuple[NoiseStack, ...]:
        """Noise stacks of the terrain."""
        outline = self.extent / 5
        crest = min(self.extent * _CREST_SHARE, _MAX_CREST)
        return (
            NoiseStack("ground", self.ground["wavelength"], self.ground["roughness"]),
            NoiseStack("warp_u", outline, 0.45, most=3),
            NoiseStack("warp_v", outline, 0.45, most=3),
            NoiseStack("ridge", self.ridge_wavelength, 0.42, most=2),
            NoiseStack("gully", self.extent / 8, 0.45, most=9),
            NoiseStack("crag", self.extent / 512, 0.5),
            NoiseStack("crest", crest, 0.42, most=4),
            NoiseStack("mottle", self.extent / 12, 0.62, most=8),
        )
