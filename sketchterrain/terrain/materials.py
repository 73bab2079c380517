"""The materials the ground is covered with."""

from __future__ import annotations

__all__ = ["MATERIALS"]

MATERIALS = ("grass", "soil", "rock", "scree", "sand", "snow", "river_bed", "forest_floor")
"""Names of the material weights, in the order of ``kernels/materials.clh``."""
