"""A layer that is declared and nothing else: everything that shows, imports or lists layers handles it."""

import importlib.util
import os
import subprocess
import sys
import types
from pathlib import Path

import pytest

CAVE = """Layer(
    *("cave", "Caves", 77, "{kind}", "where caves are"),
    parameter_table(Parameter("length", float, 30.0, 1.0, 900.0, "m", "from end to end")),
    colour=(200, 40, 160),
    hatch="level",
    map_colours="#d010b0",
    tags=(TagRule("natural", "cave_entrance", {{"length": 55.0}}),),
    source_names="grottos",
)"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["landform", "water"])
def test_a_layer_needs_only_its_declaration(kind):
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    command = [sys.executable, __file__, kind]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def plant(kind: str) -> None:
    """Import the declaration of layers with another one, before anything reads it."""
    spec = importlib.util.find_spec("sketchterrain.schema.layers")
    source = Path(spec.origin).read_text(encoding="utf-8")
    mark = "LAYERS: Mapping"
    assert source.count(mark) == 1
    module = types.ModuleType(spec.name)
    sys.modules[spec.name] = module
    exec(source.replace(mark, f"_ALL += ({CAVE.format(kind=kind)},)\n{mark}"), module.__dict__)  # noqa: S102 # our own file


def main(kind: str, folder: Path) -> None:
    plant(kind)
    import json

    import numpy as np
    from PIL import Image
    from PyQt6.QtWidgets import QApplication

    from sketchterrain.app.listings import preset_entry
    from sketchterrain.batch.plan import parse_setting, with_settings
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.document.store import load_sketch, save_sketch
    from sketchterrain.generation.building import build, rebuild
    from sketchterrain.importing.images import read_map
    from sketchterrain.importing.layered import trace_mask
    from sketchterrain.importing.legend import OWN_LEGEND, feature_label, parse_layer_name
    from sketchterrain.importing.traced_layers import TraceOptions, sketch_picture
    from sketchterrain.importing.vectors import sketch_from_vectors
    from sketchterrain.jobs.generate import sketch_notes
    from sketchterrain.measure.adherence import measure_adherence
    from sketchterrain.measure.lines import adherence_lines
    from sketchterrain.render.overlays import FEATURE_COLOURS
    from sketchterrain.schema.layers import DRAW_ORDER, LAYERS, PAINTED_LAYERS, layer_of
    from sketchterrain.ui.actions import COMMANDS
    from sketchterrain.ui.canvas.compositing import paints_of
    from sketchterrain.ui.dialogs.trace import meaning_box
    from sketchterrain.ui.look.layer_colours import GLYPHS, HATCHES, hatch_colour, label_colour, swatch
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.workspace import Workspace
    from sketchterrain.ui.panels.layers import LayersPanel, label_detail
    from sketchterrain.ui.panels.properties import LabelPage
    from sketchterrain.ui.panels.status_line import AdherenceBar

    application = QApplication([])
    image = np.zeros((48, 48), np.uint8)
    image[10:30, 12:36] = 1
    sketch = Sketch(extent=600.0, layers={"cave": image})

    # The document.
    assert sketch.properties("cave", 1) == {"length": 30.0}
    assert layer_of(77 << 48 | 5) == "cave"
    save_sketch(with_settings(sketch, {"cave.1.length": 44.0}), folder / "sketch")
    loaded = load_sketch(folder / "sketch")
    assert loaded.properties("cave", 1)["length"] == 44.0
    assert np.array_equal(loaded.layers["cave"], image)
    assert parse_setting("cave.1.length", [3.0, 4.0]).values == (3.0, 4.0)
    assert sketch_notes(sketch)
    assert preset_entry("x", sketch)["layers"] == ["cave"]

    # Imports: by the layer's colour, a map's colour, tags, and the names of files and layers.
    assert OWN_LEGEND.meaning((0xD0, 0x10, 0xB0)).layer == "cave"
    assert parse_layer_name("Caves 2") == ("cave", 2)
    for tags in ({"natural": "cave_entrance"}, {"landuse": "cave_entrance"}, {"fclass": "cave_entrance"}):
        assert feature_label(tags, "", None).properties == {"length": 55.0}, tags
    assert feature_label({}, "grottos", None).layer == "cave"
    picture = np.full((96, 96, 3), 255, np.uint8)
    picture[20:70, 30:80] = LAYERS["cave"].colour
    Image.fromarray(picture).save(folder / "map.png")
    for narrow in (0.0, 4.0):
        assert read_map(folder / "map.png").traced(TraceOptions(), narrow=narrow).sketch.layers["cave"].any()
    assert trace_mask(folder / "map.png", "cave", TraceOptions()).sketch.layers["cave"].any()
    ring = [[0.0, 0.0], [900.0, 0.0], [900.0, 700.0], [0.0, 0.0]]
    cave = {
        "type": "Feature",
        "properties": {"layer": "caves"},
        "geometry": {"type": "LineString", "coordinates": ring},
    }
    collection = {"type": "FeatureCollection", "features": [cave]}
    collection["crs"] = {"type": "name", "properties": {"name": "EPSG:32632"}}
    (folder / "caves.geojson").write_text(json.dumps(collection))
    assert (sketch_from_vectors(folder / "caves.geojson").sketch.layers["cave"] == 1).any()
    assert (sketch_picture(sketch)[20, 20] == LAYERS["cave"].colour).all()

    # The terrain around it.
    terrain = build(sketch)
    if kind == "water":
        from sketchterrain.export.map.sheet import map_sheet

        assert map_sheet(terrain).layers["legend"]
    lines = adherence_lines(
        {"sketch": "x", "seed": 0, "fidelity": 1, "notes": []} | measure_adherence(terrain).as_dict()
    )
    assert any(line.startswith("cave") for line in lines)
    assert ("cave" in FEATURE_COLOURS) == (kind == "water")
    rebuild(terrain, sketch.replace(layers={}))

    # The window.
    assert DRAW_ORDER.index("material") < DRAW_ORDER.index("cave") < DRAW_ORDER.index("river")
    workspace, document = Workspace(), Document(sketch)
    workspace.use_label("cave", 1)
    assert COMMANDS["layer-cave"].text.endswith("Caves")
    assert len({layer.code for layer in LAYERS.values()}) == len(LAYERS)
    for layer in LAYERS.values():
        assert (layer.hatch in HATCHES) == layer.is_painted, layer.name
        assert (layer.glyph in GLYPHS) == layer.is_points, layer.name
    assert label_colour("cave", 1).getRgb()[:3] == LAYERS["cave"].colour
    assert label_colour("cave", 2) != label_colour("cave", 1)
    assert hatch_colour("cave").alpha()
    assert not swatch("cave", 1, 16).isNull()
    assert "cave" in [paint.layer for paint in paints_of(workspace)]
    assert len(paints_of(workspace)) == len(PAINTED_LAYERS)
    assert label_detail(sketch, "cave", 1, 480).startswith("30 m · ")
    panel, page = LayersPanel(document, workspace), LabelPage(document, workspace)
    panel.clear_layer()
    assert not document.sketch.layers["cave"].any()
    assert list(page.form.rows) == ["length"]
    assert meaning_box().findText("Caves") >= 0
    AdherenceBar("cave").grab()
    panel.grab()
    application.processEvents()


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        main(sys.argv[1], Path(place))
