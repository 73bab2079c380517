"""Covers: painted materials over those that the rules select."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import StructuredArray
from sketchterrain.landforms.placement.feature_types import Cover
from sketchterrain.terrain.layers.fields import field_items, pack_fields
from sketchterrain.terrain.layers.layer import ITEMS, Packed, Sampling, TerrainLayer, WorldSettings

# Half the width of a cover's border, in samples, at fidelity 1 and at 0; small shapes have narrower ones.
_BORDER: Final = (0.35, 3.0)
_BORDER_DEPTHS = 0.5


@dataclass(frozen=True, eq=False)
class CoversLayer(TerrainLayer):
    """Painted materials, later ones on top."""

    name: ClassVar[str] = "covers"
    varies_with_cell: ClassVar[bool] = False
    surface: ClassVar[bool] = True

    covers: tuple[Cover, ...] = field(metadata=ITEMS)

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return the covers by their contents."""
        settings = [(cover.material, cover.strength) for cover in self.covers]
        return field_items([cover.shape for cover in self.covers], settings, world.extent)

    def pack(self, sampling: Sampling) -> Packed:
        """Return the fields with borders that are wider at lower fidelity, but within the fields' margins."""
        fields = pack_fields([cover.shape for cover in self.covers], sampling.world.extent)
        spacing = np.array([cover.shape.spacing for cover in self.covers], dtype=np.float64)
        sharp, loose = _BORDER
        half = spacing * (loose + (sharp - loose) * sampling.world.fidelity)
        half = np.minimum(half, np.maximum(_BORDER_DEPTHS * fields.depth, sharp * spacing))
        # Noise moves the border by up to its own width (``kernels/layers/covers.clh``).
        half = np.minimum(half, fields.margin / 2)
        strength = np.array([cover.strength for cover in self.covers], dtype=np.float64)
        form = fields.form.copy()
        form[:, 3] = [cover.material for cover in self.covers]
        shape = np.stack([fields.scale, 0.5 / half, strength, np.zeros(len(half))], axis=-1)
        arrays: dict[str, npt.NDArray[Any]] = {
            "cover_at": fields.at,
            "cover_form": form,
            "cover_shape": shape,
            "cover_samples": fields.samples,
        }
        return Packed(arrays, fields.boxes, "cover")
