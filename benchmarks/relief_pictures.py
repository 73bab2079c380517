"""The pictures of the pages on relief and erosion (``docs/kernels``), made from the terrain itself.

``python -m sketchterrain.benchmarks.relief_pictures DIR`` writes them.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.io.files import write_atomic
from sketchterrain.terrain.building import build
from sketchterrain.terrain.evaluator import MASKS, Evaluator
from sketchterrain.terrain.lattice import to_lattice

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.terrain.terrain import Terrain

    Pixels = npt.NDArray[np.float64]
    Window = tuple[float, float, float]

_SUN = np.array([-0.55, 0.55, 0.6]) / np.linalg.norm([-0.55, 0.55, 0.6])
_SIDE = 500
_SKETCH = 128  # px
_EXTENT = 3072.0
_STYLE = {"font.size": 9.0, "axes.titlesize": 9.0, "savefig.dpi": 90}
_RANGE = (4200.0, 6300.0, 5200.0)  # west, south and width of a part of alpine_range, m


def main(arguments: list[str]) -> int:
    """Write all pictures into the folder that is named."""
    import matplotlib as mpl
    from PIL import Image

    folder = Path(arguments[0])
    context = ComputeContext()
    with mpl.rc_context(_STYLE):
        for name, draw in PICTURES.items():
            drawn, small = io.BytesIO(), io.BytesIO()
            draw(context).savefig(drawn, format="png")
            Image.open(drawn).convert("L").save(small, format="png", optimize=True)
            write_atomic(folder / f"{name}.png", small.getvalue())
    return 0


def draw_relief(context: ComputeContext) -> Any:
    """Draw mountains, hills, dunes and a forest's cover, shaded by the sun."""
    rows, columns = np.mgrid[:_SKETCH, :_SKETCH]

    def disc(row: float, column: float, radius: float) -> npt.NDArray[np.bool_]:
        return np.asarray(np.hypot(rows - row, columns - column) < radius)

    one, two = disc(64, 64, 36), disc(64, 42, 26) | disc(60, 84, 26)
    mountain = {"height": 650.0, "peakiness": 0.7}
    views = {
        "a mountain, erosion = 0": _shape(context, "mountain", one, mountain | {"erosion": 0.0}),
        "erosion = 0.7": _shape(context, "mountain", one, mountain),
        "two shapes": _shape(context, "mountain", two, mountain | {"multitude": 2}),
        "hills of one shape": _shape(context, "hill", two, {"height": 160.0, "multitude": 5}),
    }
    figure = _figure(9.0, 6.3)
    panels = list(figure.subplots(2, 3).flat)
    for (title, terrain), axes in zip(views.items(), panels, strict=False):
        _show(axes, terrain, (0.0, 0.0, _EXTENT), title)
    desert = build(load_sketch("desert_mountains"), device=context)
    _show(panels[4], desert, (2500.0, 2200.0, 2000.0), "dunes, desert_mountains")
    valley = build(load_sketch("valley_river"), device=context)
    x, y, where = _places((1500.0, 1500.0, 3000.0))
    evaluator = Evaluator(valley.recipe, context)
    at = (to_lattice(each.ravel(), valley.extent) for each in (x, y))
    _, masks = evaluator.points(*at, cell_size=where["extent"][1] / _SIDE)
    panels[5].imshow(masks[:, MASKS.index("forest")].reshape(x.shape), cmap="gray_r", vmin=0, vmax=1, **where)
    panels[5].set_title("share of places with trees, valley_river", loc="left")
    for axes in panels:
        axes.set(xticks=[], yticks=[])
    return figure


def draw_erosion(context: ComputeContext) -> Any:
    """Draw a part of a range without gullies, and with those that ever smaller cells can carry."""
    sketch = load_sketch("alpine_range")
    still = {
        key: {**values, "erosion": 0.0}
        for key, values in sketch.labels.items()
        if key[0] in ("mountain", "hill")
    }
    plain = build(sketch.replace(labels={**sketch.labels, **still}), device=context)
    eroded = build(sketch, device=context)
    figure = _figure(9.0, 9.2)
    views = (
        ("without gullies", plain, 8.0),
        ("cells of 256 m: the widest gullies", eroded, 256.0),
        ("cells of 64 m", eroded, 64.0),
        ("cells of 8 m", eroded, 8.0),
    )
    for axes, (title, terrain, cell) in zip(figure.subplots(2, 2).flat, views, strict=True):
        _show(axes, terrain, _RANGE, title, cell=cell)
        axes.set(xticks=[], yticks=[])
    return figure


def _shape(
    context: ComputeContext, layer: str, painted: npt.NDArray[np.bool_], label: dict[str, float]
) -> Terrain:
    sketch = Sketch(
        extent=_EXTENT,
        seed=4,
        layers={layer: painted.astype(np.uint8)},
        labels={(layer, 1): label},
        density=dict.fromkeys(("mountain", "hill", "dune", "forest"), 0.0),
    )
    return build(sketch, device=context)


def _places(window: Window) -> tuple[Pixels, Pixels, dict[str, Any]]:
    west, south, width = window
    along = np.linspace(0.0, width, _SIDE)
    x, y = np.meshgrid(west + along, south + along)
    return x, y, {"extent": (0.0, width, 0.0, width), "origin": "lower"}


def _show(axes: Any, terrain: Terrain, window: Window, title: str, *, cell: float | None = None) -> None:
    x, y, where = _places(window)
    spacing = window[2] / (_SIDE - 1)
    height = terrain.heights(x, y, cell_size=spacing if cell is None else cell).astype(np.float64)
    north, east = np.gradient(height, spacing)
    light = (_SUN[2] - _SUN[0] * east - _SUN[1] * north) / np.sqrt(1.0 + east**2 + north**2)
    axes.imshow(0.15 + 0.85 * np.maximum(light, 0.0), cmap="gray", vmin=0.0, vmax=1.05, **where)
    axes.set_title(title, loc="left")


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


PICTURES = {"relief": draw_relief, "erosion": draw_erosion}
"""How each picture is drawn, by the name of its file."""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
