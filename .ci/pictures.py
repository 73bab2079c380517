"""The pictures of the presets in README and docs: `python .ci/pictures.py [NAME…]` renders them again."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyogrio
import shapely
from PIL import Image

import sketchterrain as st
from sketchterrain.document.drapes import draped_layer
from sketchterrain.drape.drapes import Drapes
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.offscreen import render_picture
from sketchterrain.render.sky import Weather

ROOT = Path(__file__).parents[1]
WIDE = (1440, 810)
PAIR = (880, 495)  # each of two pictures side by side
GAP = 8  # px between them
PREVIEW = (480, 270)  # of the list of presets

# name: preset, hour or None, views: a kind, or eye and target (x, y, metres above the surface)
PICTURES: dict[str, tuple[str, float | None, list[str | tuple[float, ...]]]] = {
    "alpine_dawn": ("alpine_range", 6.75, ["hill"]),
    "alpine_range": ("alpine_range", None, ["ground"]),
    "alpine_range_far": ("alpine_range", None, ["air"]),
    "andorra": ("andorra", None, ["ground"]),
    "andorra_far": ("andorra", None, ["air"]),
    "canyon_mesa": ("canyon_mesa", None, ["ground"]),
    "canyon_mesa_far": ("canyon_mesa", None, ["air"]),
    "desert_mountains": ("desert_mountains", None, ["ground"]),
    "desert_mountains_far": ("desert_mountains", None, ["air"]),
    "island_coast": ("island_coast", None, ["ground"]),
    "island_coast_far": ("island_coast", None, ["air"]),
    "mountain_pass": ("mountain_pass", None, [(3773.5, 2021.0, 1.9, 3733.0, 2055.2, 1.5)]),
    "mountain_pass_far": ("mountain_pass", None, ["air"]),
    "rolling_hills": ("rolling_hills", None, ["ground"]),
    "rolling_hills_far": ("rolling_hills", None, ["air"]),
    "valley_river": ("valley_river", None, ["ground"]),
    "valley_river_far": ("valley_river", None, ["hill"]),
    "near_ground": ("valley_river", None, [(3000, 900, 1.2, 2990, 940, 1.0)]),
    "roads_hairpin": (
        "mountain_pass",
        None,
        [(3905, 1900, 60, 3735, 2005, -7), (3773.5, 2021.0, 1.9, 3733.0, 2055.2, 1.5)],
    ),
    "roads_bridge": (
        "mountain_pass",
        None,
        [(3300, 1228, 26, 3184, 1304, 5), (3246, 1302, 1.7, 3183, 1304, 5)],
    ),
    "landuse_valley": (
        "mountain_pass",
        None,
        [(4050, 700, 170, 4350, 1300, 0), (3745, 1262, 1.9, 3950, 1330, 1)],
    ),
    "landuse_village": (
        "mountain_pass",
        None,
        [(3345, 1135, 52, 3160, 1185, 0), (3122, 1158, 1.7, 3215, 1172, 1)],
    ),
    "roads_junction": (
        "andorra",
        13.0,
        [(7712.5, 9427.5, 60, 7792.5, 9527.5, 0), (7742.5, 9500.5, 1.7, 7792.5, 9529.5, 1)],
    ),
    "drapes_hill": (
        "andorra",
        None,
        [(10700, 12550, 120, 11050, 13000, 0), (11010, 12790, 1.7, 10850, 12950, 0)],
    ),
}
MEADOW = (10950.0, 12850.0)  # m, of the parcels of drapes_hill


def draped(folder: Path, terrain: st.Terrain) -> Drapes:
    """Return numbered parcels and a trail, as files in a folder."""
    sketch = terrain.sketch
    corner = np.array([sketch.frame["east"], sketch.frame["north"]])
    within = shapely.Point(MEADOW).buffer(330.0)
    sites = np.random.default_rng(3).uniform(-400.0, 400.0, (160, 2)) + MEADOW
    parcels = shapely.intersection(
        shapely.get_parts(shapely.voronoi_polygons(shapely.MultiPoint(sites))), within
    )
    way = np.linspace(-1.0, 1.0, 80)
    trail = np.stack([900.0 * way, 60.0 * np.sin(9.0 * way) + 500.0 * way], axis=1) + MEADOW
    parcels = parcels[~shapely.is_empty(parcels)]
    for name, shapes in ("parcels", parcels), ("trail", np.array([shapely.LineString(trail)])):
        pyogrio.raw.write(
            folder / f"{name}.fgb",
            shapely.to_wkb(shapely.transform(shapes, lambda points: points + corner)),
            [np.arange(101, 101 + len(shapes))],
            ["number"],
            geometry_type=shapes[0].geom_type,
            crs=sketch.frame["crs"],
        )
    layers = (
        draped_layer(
            folder / "parcels.fgb",
            colour="#fff4d0",
            width=1.5,
            unit="m",
            fill="#e0a020",
            fill_opacity=0.25,
            label="number",
        ),
        draped_layer(folder / "trail.fgb", colour="#ff6a1a", width=2.5, unit="m", dash="12 8"),
    )
    return Drapes.open(layers, sketch.frame, terrain.size, terrain.extent)


def picture(
    terrain: st.Terrain,
    view: str | tuple[float, ...],
    hour: float | None,
    size: tuple[int, int],
    drapes: Drapes | None = None,
) -> npt.NDArray[np.uint8]:
    """Return a picture (height, width, 3)."""
    weather = Weather.from_sketch(terrain.sketch, hour=hour)
    if isinstance(view, str):
        return render_picture(terrain, size=size, view=view, weather=weather)
    ends = [(x, y, float(terrain.heights(x, y)) + above) for x, y, above in (view[:3], view[3:])]
    return render_picture(terrain, size=size, camera=Camera(*ends), weather=weather, drapes=drapes)


def main(names: list[str]) -> None:
    """Render some or all pictures into docs and presets."""
    terrains: dict[str, st.Terrain] = {}
    for name in names or PICTURES:
        preset, hour, views = PICTURES[name]
        terrain = terrains.pop(preset, None) or st.build(st.load_sketch(preset))
        terrains = {preset: terrain}
        size = WIDE if len(views) == 1 else PAIR
        with tempfile.TemporaryDirectory() as folder:
            drapes = draped(Path(folder), terrain) if name == "drapes_hill" else None
            parts = [picture(terrain, view, hour, size, drapes) for view in views]
        gap = np.full((len(parts[0]), GAP, 3), 255, np.uint8)
        image = Image.fromarray(np.hstack([parts[0], *(each for part in parts[1:] for each in (gap, part))]))
        image.save(ROOT / "docs" / f"{name}.jpg", quality=88, optimize=True)
        if name == preset:
            image.resize(PREVIEW, Image.Resampling.LANCZOS).save(
                ROOT / "presets" / preset / "picture.jpg", quality=88, optimize=True
            )
        print(name, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
