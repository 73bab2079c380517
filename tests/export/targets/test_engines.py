"""What holds of exports to all engines."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

import sketchterrain as st
from sketchterrain.export.target import ExportOptions
from sketchterrain.exporting import plan_of, write_export
from sketchterrain.progress import Stages

if TYPE_CHECKING:
    from pathlib import Path

ENGINES = [("unity", {"size": 33}), ("unreal", {"size": 127, "format": "r16"}), ("godot", {})]


@pytest.fixture(scope="module")
def bare(corner: st.Sketch) -> st.Terrain:
    """Ground with nothing on it: no river, no lake, no wood."""
    return st.build(replace(corner, extent=256.0, layers={}, labels={}))


@pytest.mark.parametrize(("target", "options"), ENGINES)
def test_bare_ground_is_exported_to_the_same_bytes_without_water_and_plants(
    bare: st.Terrain, tmp_path: Path, target: str, options: dict[str, Any]
) -> None:
    written = []
    for name in ("one", "two"):
        folder = tmp_path / name
        folder.mkdir()
        done = write_export(
            plan_of(bare.sketch, target, ExportOptions(**options)), bare, folder, stages=Stages()
        )
        written.append({path.name: path.read_bytes() for path in done.files})
    assert written[0] == written[1]

    plan = plan_of(bare.sketch, target, ExportOptions(plants=False, **options))
    done = write_export(plan, bare, tmp_path, stages=Stages())
    names = {path.name for path in done.files}
    assert "high_corner_water.json" in names
    assert not [name for name in names if "plants" in name or "grass.json" in name]
    text = (tmp_path / "high_corner_water.json").read_text(encoding="utf-8")
    assert '"rivers": []' in text
    assert '"lakes": []' in text
    assert all(entry["what"] for entry in done.report["files"])
    assert done.report["axes"]["unit"] in {"m", "cm"}
    assert done.report["grid"]["spacing"]["x"] > 0.0
