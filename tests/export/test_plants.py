from __future__ import annotations

import csv
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sketchterrain.export import write_foliage

if TYPE_CHECKING:
    from pathlib import Path

    import sketchterrain as st

PLANT = np.dtype(
    [("x", "f8"), ("y", "f8"), ("z", "f4"), ("species", "u1"), ("scale", "f4"), ("rotation", "f4")]
)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="ascii") as stream:
        return list(csv.DictReader(stream))


def test_each_plant_is_a_line_in_order(tmp_path: Path, terrain: st.Terrain) -> None:
    plants = terrain.foliage(0.0, 0.0, *terrain.size)
    assert len(plants) > 100
    rows = rows_of(write_foliage(tmp_path, plants, terrain.species_names)[0])
    assert list(rows[0]) == ["x", "y", "z", "species", "scale", "rotation"]
    assert [row["species"] for row in rows] == [terrain.species_names[i] for i in plants["species"]]
    for name, half in {"x": 0.0005, "y": 0.0005, "z": 0.0005, "scale": 0.0005, "rotation": 0.00005}.items():
        read = np.array([float(row[name]) for row in rows])
        np.testing.assert_allclose(read, plants[name], rtol=1e-7, atol=1.001 * half)


def test_plants_stand_on_the_ground_inside_the_sketch(tmp_path: Path, terrain: st.Terrain) -> None:
    plants = terrain.foliage(0.0, 0.0, *terrain.size)
    rows = rows_of(write_foliage(tmp_path, plants, terrain.species_names)[0])
    x, y, z = (np.array([float(row[name]) for row in rows]) for name in "xyz")
    east, north = terrain.size
    assert ((x >= 0) & (x <= east) & (y >= 0) & (y <= north)).all()
    # The positions are rounded to the millimetre; the ground is nowhere steeper than 20 to 1.
    np.testing.assert_allclose(z, terrain.heights(x, y), rtol=0, atol=0.02)


def test_no_plants_are_a_table_without_rows(tmp_path: Path) -> None:
    (path,) = write_foliage(tmp_path, np.zeros(0, PLANT), ("fir",))
    assert path.read_bytes() == b"x,y,z,species,scale,rotation\n"


def test_numbers_have_fixed_decimals_and_no_negative_zero(tmp_path: Path) -> None:
    plants = np.array([(1e6 + 1 / 3, 2.0, -1e-5, 1, 1.25, 6.28318)], PLANT)
    (path,) = write_foliage(tmp_path, plants, ("fir", "oak"))
    assert path.read_text(encoding="ascii").splitlines()[1] == "1000000.333,2.000,0.000,oak,1.250,6.2832"


@pytest.mark.slow
def test_a_million_plants_take_seconds(tmp_path: Path) -> None:
    plants = np.zeros(1_000_000, PLANT)
    plants["x"] = np.random.default_rng(1).random(len(plants)) * 4096
    start = time.perf_counter()
    write_foliage(tmp_path, plants, ("fir",))
    assert time.perf_counter() - start < 15
