from __future__ import annotations

import csv
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export.foliage_files import ROW_BYTES, plant_table
from sketchterrain.terrain.plant import PLANT, SPECIES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import sketchterrain as st

COLUMNS = ["x", "y", "z", "species", "scale", "rotation", "tint", "normal_x", "normal_y", "normal_z"]


def written(folder: Path, plants: np.ndarray, species: Sequence[str] = SPECIES) -> Path:
    with plant_table(folder / "foliage.csv", species) as add:
        add(plants)
    return folder / "foliage.csv"


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="ascii") as stream:
        return list(csv.DictReader(stream))


def test_each_plant_is_a_line_in_order_on_the_ground(tmp_path: Path, terrain: st.Terrain) -> None:
    plants = terrain.foliage(0.0, 0.0, *terrain.size)
    assert len(plants) > 100
    rows = rows_of(written(tmp_path, plants))
    assert list(rows[0]) == COLUMNS
    assert [row["species"] for row in rows] == [terrain.species_names[i] for i in plants["species"]]
    fields = {name: plants[name] for name in ("x", "y", "z", "scale", "rotation", "tint")}
    fields |= {name: plants["normal"][:, axis] for axis, name in enumerate(COLUMNS[-3:])}
    for name, field in fields.items():
        half = 0.00005 if name == "rotation" or name.startswith("normal") else 0.0005
        read = np.array([float(row[name]) for row in rows])
        np.testing.assert_allclose(read, field, rtol=1e-7, atol=1.001 * half)

    rows = rows_of(written(tmp_path, terrain.foliage(0.0, 0.0, *terrain.size)))
    x, y, z = (np.array([float(row[name]) for row in rows]) for name in "xyz")
    east, north = terrain.size
    assert ((x >= 0) & (x <= east) & (y >= 0) & (y <= north)).all()
    # The positions are rounded to the millimetre; the ground is nowhere steeper than 20 to 1.
    np.testing.assert_allclose(z, terrain.heights(x, y), rtol=0, atol=0.02)


def test_numbers_have_fixed_decimals_and_bounded_length(tmp_path: Path) -> None:
    plant = (1e6 + 1 / 3, 2.0, -1e-5, (0.6, -0.0, 0.8), 1, 3, 1.25, 6.28318, 0.5)
    path = written(tmp_path, np.array([plant], PLANT), ("fir", "oak"))
    line = "1000000.333,2.000,0.000,oak,1.250,6.2832,0.500,0.6000,0.0000,0.8000"
    assert path.read_text(encoding="ascii").splitlines()[1] == line

    plant = (-999999.999, -999999.999, -9999.9999, (-1, -1, 1), 0, 0, 1.25, 6.28318, 1.0)
    path = written(tmp_path, np.array([plant], PLANT))
    assert len(path.read_bytes().splitlines(keepends=True)[1]) <= ROW_BYTES

    path = written(tmp_path, np.zeros(0, PLANT), ("fir",))
    assert path.read_text(encoding="ascii") == ",".join(COLUMNS) + "\n"


def test_pieces_join(tmp_path: Path, plants: Callable[[int], np.ndarray]) -> None:
    some = plants(70_000)
    whole = written(tmp_path, some).read_bytes()
    with plant_table(tmp_path / "pieces.csv", SPECIES) as add:
        for piece in np.split(some, [0, 1, 999, 40_000]):
            add(piece)
    assert (tmp_path / "pieces.csv").read_bytes() == whole
    assert whole.count(b"\n") == 70_001


def test_non_finite_plants_and_missing_folders_leave_no_table(
    tmp_path: Path, plants: Callable[[int], np.ndarray]
) -> None:
    some = plants(10)
    some["tint"][3] = np.nan
    with pytest.raises(InputError, match=r"finite numbers .* got nan"):
        written(tmp_path, some)
    assert list(tmp_path.iterdir()) == []

    with pytest.raises(SketchterrainError, match=r"no.foliage\.csv: cannot be written \(No such file"):
        written(tmp_path / "no", np.zeros(0, PLANT))


def test_an_interrupt_leaves_the_old_table_whole(tmp_path: Path, plants: Callable[[int], np.ndarray]) -> None:
    old = written(tmp_path, plants(3)).read_bytes()

    def interrupted() -> None:
        with plant_table(tmp_path / "foliage.csv", SPECIES) as add:
            add(plants(50_000))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [entry.name for entry in tmp_path.iterdir()] == ["foliage.csv"]
    assert (tmp_path / "foliage.csv").read_bytes() == old


@pytest.mark.slow
def test_a_million_plants_take_seconds(tmp_path: Path, plants: Callable[[int], np.ndarray]) -> None:
    some = plants(1_000_000)
    start = time.perf_counter()
    written(tmp_path, some)
    assert time.perf_counter() - start < 5
