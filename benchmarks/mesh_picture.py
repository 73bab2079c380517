"""Meshes at two error bounds as a picture: triangles over shaded ground.

``python -m sketchterrain.benchmarks.mesh_picture FILE`` draws it.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from PIL import Image

from sketchterrain.benchmarks.grounds import open_ground
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.export.mesh import adaptive_mesh
from sketchterrain.export.sampled import SampleGrid, sample_terrain
from sketchterrain.io.files import write_atomic

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    import numpy.typing as npt

_PRESET: Final = "alpine_range"
_PLACE: Final = (0.62, 0.52, 0.1)  # of the preset's width: west, south, side
_INK: Final = "#333333"


def draw_meshes(height: npt.NDArray[np.float32], spacing: float, errors: Sequence[float]) -> Any:
    """Draw a panel for each error: the ground lit from the north-west, and the mesh's edges.

    Parameters
    ----------
    height
        (rows, columns) m; row 0 is the north edge.
    spacing
        m.
    errors
        m.
    """
    from matplotlib.colors import LightSource
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0 * len(errors), 6.3), layout="constrained")
    shade = LightSource(315.0, 40.0).hillshade(height[::-1], dx=spacing, dy=spacing)
    rows, columns = height.shape
    for axes, error in zip(figure.subplots(1, len(errors), squeeze=False)[0], errors, strict=True):
        mesh, measured = adaptive_mesh(height, error)
        ends = (-0.5, columns - 0.5, -0.5, rows - 0.5)
        axes.imshow(shade, cmap="gray", vmin=-0.4, vmax=1.0, origin="lower", extent=ends)
        x, y = mesh.column, rows - 1 - mesh.row
        axes.triplot(x, y, mesh.triangles, color="#0072B2", linewidth=0.45)
        axes.set(xticks=[], yticks=[], xlim=(0, columns - 1), ylim=(0, rows - 1))
        share = 100.0 * len(mesh.triangles) / (2 * (rows - 1) * (columns - 1))
        axes.set_title(
            f"{len(mesh.triangles):,} triangles, {share:.2g} % of the grid's; off by {measured:.3g} m",
            fontsize=10.0,
            color=_INK,
        )
    return figure


def main(arguments: Sequence[str] | None = None, *, side: int = 257) -> int:
    """Draw the picture into the file that is named, PNG or JPEG."""
    (name,) = sys.argv[1:] if arguments is None else arguments
    terrain = open_ground(_PRESET, TimedContext())
    west, south, width = (share * terrain.size[0] for share in _PLACE)
    grid = SampleGrid(west, south, west + width, south + width, side, side)
    figure = draw_meshes(sample_terrain(terrain, grid).height, grid.spacing[0], (12.0, 3.0))
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=95)
    path = Path(name)
    picture = io.BytesIO()
    kind = "PNG" if path.suffix == ".png" else "JPEG"
    Image.open(stream).convert("RGB").save(picture, format=kind, quality=78)
    write_atomic(path, picture.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main())
