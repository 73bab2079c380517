"""Plateaus: talus, a layered cliff, a top with the relief of the ground."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, LatticeArray, StructuredArray
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.landforms.placement.feature_types import cubic, even_wave
from sketchterrain.landforms.placement.plateaus import (
    CLIFF_GAIN,
    CLIFF_NOISE,
    NOISE_REACH,
    Plateau,
    cliff_looseness,
    layer_phase,
    noise_limit,
    octave_share,
)
from sketchterrain.terrain.layers.fields import (
    FieldRows,
    PackedFields,
    field_distance,
    field_items,
    pack_fields,
)
from sketchterrain.terrain.layers.layer import (
    ITEMS,
    Culled,
    DetailState,
    HostSamples,
    HostSite,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
    smooth_rise,
    soft_positive,
)
from sketchterrain.terrain.noise import (
    FINEST_CELL,
    NoiseStack,
    band_weight,
    octave_noise,
    omitted_amplitudes,
)

_HEADER: Final = "layers/plateaus.clh"
PLATEAU: Final = kernel_columns(_HEADER, "PlateauRow")
"""Columns of packed plateaus."""
_CLIFF_ROUND, _RISER, _HARDNESS_RATE, _SOFT_ROCK, _VARIETY, _TILTED, _CRUMBLED = kernel_constants(
    _HEADER, "CLIFF_ROUND", "RISER", "HARDNESS_RATE", "SOFT_ROCK", "VARIETY", "TILTED", "CRUMBLED"
)
_STRATA_START, _INVERSE_STRATA, _RIM_SOFTNESS, _TOP_EDGE = kernel_constants(
    _HEADER, "STRATA_START", "INVERSE_STRATA", "RIM_SOFTNESS", "TOP_EDGE"
)
_INVERSE_MASK, _INVERSE_DRAINED = kernel_constants(_HEADER, "INVERSE_CLIFF_MASK", "INVERSE_DRAINED")
_CLIFF_WAVES, _INVERSE_CLIFF_WAVES, _ALCOVE_MEAN, _ALCOVE_GAIN, _ALCOVE_ROUND = kernel_constants(
    _HEADER, "CLIFF_WAVES", "INVERSE_CLIFF_WAVES", "ALCOVE_MEAN", "ALCOVE_GAIN", "ALCOVE_ROUND"
)

# Depth of the steps of layers of full strata, over their thickness, and of their thirds.
_STEPS, _THIRD_STEPS = 1.1, 0.08
_WIDENED = 2.0  # cells that a cliff is wide at least
# Greatest slopes of the steps and of the thirds over the phase, of the phase over the layers.
_STEP_SLOPE, _THIRD_SLOPE, _PHASE_SLOPE = 3.7, 7.8, 2.0
_DISTANCE_SLOPE = 1.2  # of a distance field
_TOP_ROUNDING = 1e-5  # share of the steps that the rounded height of a top leaves
_PROFILE_SAMPLES = 2049
_SETTINGS = "ground", "top", "height", "cliffness", "strata", "foot", "border", "layer_thickness"


@dataclass(frozen=True, eq=False)
class PlateausLayer(TerrainLayer):
    """Mesas, buttes and tablelands. Where several reach a point, the highest counts."""

    name: ClassVar[str] = "plateaus"
    item_masks: ClassVar[tuple[str, ...]] = ("mountain",)  # their rock and debris

    plateaus: tuple[Plateau, ...] = field(metadata=ITEMS)

    def stacks(self, world: WorldSettings) -> tuple[NoiseStack, ...]:
        """Return the noise of cliffs."""
        return (NoiseStack("cliff", world.extent / 8, 0.45, most=9),)

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return the plateaus by their contents."""
        settings = [attrgetter(*_SETTINGS)(each) for each in self.plateaus]
        return field_items([each.shape for each in self.plateaus], settings, world.extent)

    def pack(self, sampling: Sampling) -> Packed:
        """Return the fields and the profiles."""
        plateaus, fields = self._rows(sampling), self._fields(sampling.world.extent)
        shape = np.zeros((len(plateaus.row), 4))
        shape[:, 0] = fields.scale
        params = {"loose": cliff_looseness(sampling.world.fidelity)} | sampling.ranges("cliff")
        arrays: dict[str, npt.NDArray[np.generic]] = {
            "plateau_params": sampling.struct(_HEADER, "PlateauParams", params),
            "plateau_at": fields.at,
            "plateau_form": fields.form,
            "plateau_shape": shape,
            "plateau_row": plateaus.row,
            "plateau_samples": fields.samples,
        }
        return Packed(arrays, fields.boxes, "plateau", plateaus.visible, plateaus)

    def _fields(self, extent: float) -> PackedFields:
        shapes = [each.shape for each in self.plateaus]
        return self.cache.get_or_compute(extent, lambda: pack_fields(shapes, extent))

    def _rows(self, sampling: Sampling) -> FieldRows:
        """Return the profiles of plateaus; those narrower than two cells fade out and vanish at one.

        Cliffs narrower than two cells are widened about their middle; rock layers of two cells and less fade.
        """
        fields, row = self._fields(sampling.world.extent), np.zeros((len(self.plateaus), len(PLATEAU)))
        world, cell = sampling.world, sampling.cell
        for i, plateau in enumerate(self.plateaus):
            depth, talus, narrow = float(fields.depth[i]), plateau.talus_width, plateau.cliff_width
            limit = noise_limit(world.extent, world.fidelity, depth)
            cliff = max(narrow, _WIDENED * cell)
            # No farther out than the field shows.
            start = max(plateau.cliff_start + 0.5 * (narrow - cliff), talus + limit - float(fields.margin[i]))
            run = plateau.layer_thickness * narrow / ((1 - plateau.foot) * plateau.height)
            shown = band_weight(run, cell)
            steps = _STEPS * plateau.strata * plateau.layer_thickness
            for name, value in {
                "plateau_top": plateau.top,
                "plateau_foot": plateau.ground,
                "plateau_visible": float(smooth_rise(np.array(2 * depth / cell), 1, 1)),
                "talus_share": plateau.foot,
                "inverse_talus": 1 / talus,
                "inverse_cliff": 1 / cliff,
                "cliff_start": start,
                "cliff_over_talus": cliff / talus,
                "half_breadth": depth,
                "talus_width": talus,
                "cliff_noise": CLIFF_NOISE * world.extent / 8 / (1 - CLIFF_GAIN),
                "noise_limit": limit,
                "inverse_layer": 1 / plateau.layer_thickness,
                "layer_steps": steps * shown,
                "third_steps": _THIRD_STEPS
                * plateau.strata
                * plateau.layer_thickness
                * band_weight(run / 3, cell),
                "layer_sink": steps * (1 - shown) * _SOFT_ROCK * (0.5 - 0.5 * _RISER),
            }.items():
                row[i, PLATEAU[name]] = value
        return FieldRows(fields, PLATEAU, row, row[:, PLATEAU["plateau_visible"]] > 0)

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with plateaus upon it."""
        if not self.plateaus:
            return ground
        packed, fields = self._rows(site.sampling), self._fields(site.sampling.world.extent)
        height, mountain, wet = ground.height.copy(), ground.mountain.copy(), ground.wetness.copy()
        for i in np.flatnonzero(packed.visible):
            west, south, east, north = fields.boxes[i]
            near = (site.x >= west) & (site.x <= east) & (site.y >= south) & (site.y <= north)
            if not near.any():
                continue
            at = replace(site, x=site.x[near], y=site.y[near])
            row = {name: float(packed.row[i, column]) for name, column in PLATEAU.items()}
            z, rock = _raised(row, field_distance(fields, int(i), at.x, at.y), ground.height[near], at)
            height[near], mountain[near] = np.maximum(height[near], z), np.maximum(mountain[near], rock)
            wet[near] *= 1 - smooth_rise(z - ground.height[near], 0, 1 / _INVERSE_DRAINED)
        return replace(ground, height=height, mountain=mountain, wetness=wet)

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add what the cell size changes of profiles, moves of cliffs and fades of rock layers."""
        packed: FieldRows = culled.details.details
        if not len(packed.row):
            return
        block, number = packed.fields.index.touching(state.blocks)
        full = replace(sampling, cell=FINEST_CELL, octaves=sampling.all_octaves)
        rows = self.cache.get_or_compute(sampling.world, lambda: self._rows(full).row)
        moves = self.cache.get_or_compute(
            (sampling.world, sampling.cell),
            lambda: np.array([_moved(*each, sampling) for each in zip(rows, packed.row, strict=True)]),
        )
        r = {name: rows[number, column] for name, column in PLATEAU.items()}
        near = self._near_cliffs(packed, rows, state.blocks[block], number, sampling.unit)
        moved, missing = near * moves[number, 0], near * moves[number, 1] * r["inverse_layer"]
        below, rise = state.bound[block], r["plateau_top"] - r["plateau_foot"]
        lift = np.maximum(r["plateau_top"] - state.low[block], 0) + _RIM_SOFTNESS
        least = np.maximum(r["plateau_top"] - state.high[block], 0)
        # Over the share q of the way to the top, height grows by lift + 4 q^3 (rise - lift).
        growth = np.maximum(np.maximum(lift, 4 * rise - 3 * least), 3 * lift - 4 * rise)
        layers = (lift * moved + below) * r["inverse_layer"]
        varied = _VARIETY * missing + 1.5 / (1 - _TOP_EDGE) * moved
        phase = _PHASE_SLOPE * layers + _TILTED * varied
        turned = phase * (_STEP_SLOPE * r["layer_steps"] + _THIRD_SLOPE * r["third_steps"])
        most = near * (1 - _RISER) * ((1 + _CRUMBLED) * r["layer_steps"] + r["third_steps"])
        share = 1.5 * _INVERSE_STRATA * moved + 0.75 * layers + _CRUMBLED * varied
        lost = (1 + _CRUMBLED) * (r["layer_steps"] - packed["layer_steps"][number])
        lost += r["third_steps"] - packed["third_steps"][number]
        steps = np.minimum(turned + share * most + lost, most) + _TOP_ROUNDING * lost
        highest = np.maximum(state.high[block] + rise, r["plateau_top"]) + _RIM_SOFTNESS
        np.maximum.at(state.bound, block, growth * moved + below + steps)
        np.maximum.at(state.high, block, highest)
        np.maximum.at(state.scale, block, rise)

    def _near_cliffs(
        self,
        packed: FieldRows,
        full: Float64Array,
        blocks: LatticeArray,
        number: LatticeArray,
        unit: float,
    ) -> BoolArray:
        """Return whether talus or cliff of plateaus (n,) at either cell size may be in blocks (n, 4)."""
        middle = (blocks[:, :2] + blocks[:, 2:]) // 2
        reach = _DISTANCE_SLOPE * 0.5 * np.hypot(*(blocks[:, 2:] - blocks[:, :2]).T) * unit
        inside = np.zeros(len(blocks))
        for i in np.unique(number):
            own = number == i
            inside[own] = field_distance(packed.fields, int(i), *middle[own].T)
        near = np.zeros(len(blocks), np.bool_)
        for rows in (full, packed.row):
            r = {name: rows[number, column] for name, column in PLATEAU.items()}
            x, limit = inside - r["cliff_start"], reach + r["noise_limit"]
            near |= (x + limit > -r["talus_width"]) & ((x - limit) * r["inverse_cliff"] < 1)
        return near


def _raised(
    r: dict[str, float], inside: Float64Array, ground: Float64Array, site: HostSite
) -> tuple[Float64Array, Float64Array]:
    """Return the ground with one plateau (m), and how much of its cliff and talus is there."""
    wide, fine = _cliff_offset(r, site)
    still = inside - r["cliff_start"]
    x = still + wide
    x = x + fine * smooth_rise(x * r["inverse_talus"], -0.5, 0.5)
    x = np.clip(x, still - r["noise_limit"], still + r["noise_limit"])
    q = _profile(r, x)
    lift = soft_positive(r["plateau_top"] - ground, _RIM_SOFTNESS)
    free = smooth_rise(lift * r["inverse_layer"], 0, 2)
    smooth = ground + q * lift
    edge = cubic(np.maximum(q - _TOP_EDGE, 0) / (1 - _TOP_EDGE))
    vary = edge * np.clip(_VARIETY * fine * r["inverse_layer"], -1, 1)
    layers = layer_phase(smooth * r["inverse_layer"]) + _TILTED * vary
    hardness = _SOFT_ROCK + (1 - _SOFT_ROCK) * even_wave(layers * _HARDNESS_RATE) - _CRUMBLED * vary
    steps = hardness * r["layer_steps"] * _step(layers) + r["third_steps"] * _step(3 * layers)
    shown = free * smooth_rise(q, _STRATA_START, 1 / _INVERSE_STRATA)
    relief = q**4 * (r["plateau_top"] - r["plateau_foot"] - lift)
    height = smooth + shown * (steps - r["layer_sink"] * edge) + relief
    return height, free * smooth_rise(q - q * q, 0, 1 / _INVERSE_MASK)


def _profile(r: dict[str, float], x: Float64Array) -> Float64Array:
    """Return the share of the height at distances (m) inside the foot of the cliff."""
    v = np.clip(x * r["inverse_cliff"], 0, 1)
    u = np.maximum(1 + np.minimum(x, 0) * r["inverse_talus"], 0) + r["cliff_over_talus"] * (v - 0.5 * v * v)
    talus = np.minimum(r["talus_share"] * u * u, 1)
    ramp = np.where(v < 0.5, _half_ramp(v), 1 - _half_ramp(1 - v))
    return np.asarray(r["plateau_visible"] * (1 - (1 - talus) * (1 - ramp)))


def _half_ramp(v: Float64Array) -> Float64Array:
    rounded = np.minimum(v, _CLIFF_ROUND) ** 2 / (2 * _CLIFF_ROUND)
    return np.asarray((rounded + np.maximum(v - _CLIFF_ROUND, 0)) / (1 - _CLIFF_ROUND))


def _step(phase: Float64Array) -> Float64Array:
    t = phase - np.floor(phase)
    return np.asarray(smooth_rise(t, 1 - _RISER, _RISER) - t)


def _cliff_offset(r: dict[str, float], site: HostSite) -> tuple[Float64Array, Float64Array]:
    """Return by how much noise moves the cliff with its talus, and the cliff alone, m."""
    talus, cliff = np.zeros((2, *site.x.shape))
    octaves, world = site.sampling.octaves, site.sampling.world
    for i in range(*octaves.ranges["cliff"]):
        waves = octaves.scale[i, 1] / world.unit
        share, fine = octave_share(waves, r["half_breadth"], world.fidelity)
        n = octave_noise(octaves, i, site.x, site.y)
        alcove = _ALCOVE_MEAN - _ALCOVE_GAIN * np.sqrt(n * n + _ALCOVE_ROUND)
        moved = r["cliff_noise"] * octaves.scale[i, 0] * share * (n + (alcove - n) * fine)
        alone = smooth_rise(r["talus_width"] * waves, _CLIFF_WAVES, 1 / _INVERSE_CLIFF_WAVES)
        talus, cliff = talus + (1 - alone) * moved, cliff + alone * moved
    return talus, cliff


def _moved(full: Float64Array, row: Float64Array, sampling: Sampling) -> tuple[float, float]:
    """Return bounds of the change of a plateau's profile, and of the noise (m) that the cell size omits."""
    profile, resolved = (dict(zip(PLATEAU, each.tolist(), strict=True)) for each in (full, row))
    amplitude, left = omitted_amplitudes(sampling.all_octaves, sampling.octaves, "cliff")
    waves = sampling.all_octaves.scale[slice(*sampling.all_octaves.ranges["cliff"]), 1] / sampling.unit
    share, _ = octave_share(waves, profile["half_breadth"], sampling.world.fidelity)
    missing = float(NOISE_REACH * profile["cliff_noise"] * np.sum((amplitude - left) * share))
    low = min(each["cliff_start"] - each["talus_width"] for each in (profile, resolved))
    high = max(each["cliff_start"] + 1 / each["inverse_cliff"] for each in (profile, resolved))
    inside = np.linspace(low, high, _PROFILE_SAMPLES)
    one, other = (_profile(each, inside - each["cliff_start"]) for each in (profile, resolved))
    steepest = float(np.abs(np.diff(one)).max()) / (inside[1] - inside[0])
    # Noise that moves the talus also fades the noise of the cliff alone.
    faded = 1 + 6 * profile["noise_limit"] * profile["inverse_talus"]
    between = steepest * (inside[1] - inside[0]) if missing > 0 or (one != other).any() else 0.0
    return min(float(np.abs(one - other).max()) + steepest * faded * missing + between, 1.0), missing
