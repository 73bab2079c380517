"""Charts of all benchmarks. matplotlib comes with the extra ``bench``."""

import io
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from typing import Any

from sketchterrain.benchmarks.culling import draw_culling
from sketchterrain.benchmarks.drapes import draw_drapes
from sketchterrain.benchmarks.erosion import draw_erosion, draw_normals
from sketchterrain.benchmarks.flight import BUDGET, MOST
from sketchterrain.benchmarks.landforms import draw_stability, draw_terrains, draw_trade_offs
from sketchterrain.benchmarks.live import draw_live, draw_views
from sketchterrain.benchmarks.low_flight import draw_flight
from sketchterrain.benchmarks.pictures import draw_motion, draw_parts, draw_previews, draw_qualities
from sketchterrain.benchmarks.plotting import STYLE, BarPanel, Curves, draw_bars, draw_curves
from sketchterrain.benchmarks.points import draw_room, draw_spectra, draw_table_6_1
from sketchterrain.benchmarks.report import Row, Tables
from sketchterrain.benchmarks.speed import draw_rates, draw_thesis
from sketchterrain.benchmarks.splines import draw_splines
from sketchterrain.benchmarks.vector_scale import draw_scale
from sketchterrain.benchmarks.worlds import draw_worlds


def available() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


def draw(name: str, tables: Tables) -> dict[str, bytes]:
    """Return a benchmark's chart as the contents of files by suffix, or nothing if it has none.

    Also nothing where matplotlib is missing.
    """
    if name not in CHARTS or not available():
        return {}
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        drawn = {"": CHARTS[name](tables[0].rows)}
        for number, (ending, drawer) in enumerate(MORE.get(name, {}).items(), start=1):
            drawn[f"-{ending}"] = drawer(tables[number].rows)
        return {
            f"{ending}.{kind}": _saved(figure, kind)
            for ending, figure in drawn.items()
            for kind in ("png", "svg")
        }


def _saved(figure: Any, kind: str) -> bytes:
    stream = io.BytesIO()
    # No date, so that the same numbers make the same file.
    metadata = {"Date": None} if kind == "svg" else {}
    figure.savefig(stream, format=kind, dpi=120, metadata=metadata)
    return stream.getvalue()


_ACCURACY = [
    Curves(title, "ns_per_vertex", {"": key}, by="method", text="cell_size", units=("ns a vertex", unit))
    for key, title, unit in (
        ("height_mm", "heights", "largest error, mm"),
        ("normal_deg", "normals", "largest error, degrees"),
        ("material", "weights", "largest error, share of 1"),
    )
]
_FLIGHT = [
    Curves("", key, {"": MOST}, by="way", text="shown", units=(unit, "px, 99.9 % of samples"), asked=(1.0,))
    for key, unit in (("triangles", "triangles in view"), ("ms", "ms from nothing"))
]
_GENERATION = [
    BarPanel("A frame while updating", "ms", {"mean": "updating_ms"}, asked=(BUDGET * 1e3,)),
    BarPanel("Worst frame", "ms", {"most": "worst_ms"}, asked=(BUDGET * 1e3,)),
    BarPanel("Initially", "ms", {"all": "initial_ms"}),
]
_KERNELS = [BarPanel("Device time", "ns an item", {"median": "ns_per_item"})]
CHARTS: dict[str, Callable[[Sequence[Row]], Any]] = {
    "accuracy": partial(draw_curves, "Error against time, by cell size in m", _ACCURACY, each="ground"),
    "culling": draw_culling,
    "drapes": draw_drapes,
    "erosion": draw_erosion,
    "flight": partial(draw_curves, "Screen error of what is drawn", _FLIGHT),
    "kernels": partial(draw_bars, "What an item costs", _KERNELS, ("kernel", "ground", "level")),
    "landforms": draw_trade_offs,
    "live": draw_live,
    "pictures": draw_qualities,
    "points": draw_table_6_1,
    "scale": draw_scale,
    "speed": draw_rates,
    "splines": draw_splines,
    "world": draw_worlds,
}
"""How each benchmark that has a chart draws it, from the rows of its first table."""

MORE: dict[str, dict[str, Callable[[Sequence[Row]], Any]]] = {
    "erosion": {"normals": draw_normals},
    "flight": {
        "generation": partial(draw_bars, "Generation in flight", _GENERATION, ("way", "quads", "shown"))
    },
    "landforms": {"terrains": draw_terrains, "stability": draw_stability},
    "live": {"view": draw_views},
    "pictures": {"parts": draw_parts, "motion": draw_motion, "previews": draw_previews},
    "points": {"room": draw_room, "spectra": draw_spectra},
    "scale": {"flight": draw_flight},
    "speed": {"tiles": draw_thesis},
}
"""Charts of its second table and so on, by how their files' names end."""
