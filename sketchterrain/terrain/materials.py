"""The materials the ground is covered with, in the order of ``kernels/materials.clh``."""

from __future__ import annotations

from sketchterrain.document.parameters import MATERIALS

__all__ = ["MATERIALS"]
