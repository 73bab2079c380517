"""Dialog that traces a sketch from a picture."""

import json

import numpy as np
import pytest
from PIL import Image
from PyQt6.QtCore import Qt

from sketchterrain.importing.legend import NOTHING, Meaning
from sketchterrain.importing.traced_layers import sketch_picture
from sketchterrain.ui.dialogs.trace import TraceDialog

from .events import finish_reading


@pytest.fixture
def picture(tmp_path):
    """A map of 120×80 px: mountains north-west, a forest east, white between."""
    pixels = np.full((80, 120, 3), 255, np.uint8)
    pixels[5:35, 5:45] = (139, 90, 43)
    pixels[20:70, 80:115] = (0, 128, 0)
    path = tmp_path / "island.png"
    Image.fromarray(pixels).save(path)
    return path


@pytest.fixture
def opened(show_widget):
    return lambda path: show_widget(TraceDialog(path))


def wait_until_ready(qtbot, dialog: TraceDialog):
    qtbot.waitUntil(dialog.create_button.isEnabled)


def test_colours_are_detected_and_the_form_sets_size_extent_and_name(qtbot, opened, picture):
    dialog = opened(picture)
    assert not dialog.create_button.isEnabled()
    wait_until_ready(qtbot, dialog)
    assert dialog.colours.meanings == (NOTHING, Meaning("forest", 1), Meaning("mountain", 1))
    assert [box.currentText() for box in dialog.colours.boxes] == ["Nothing", "Forests", "Mountains"]
    sketch = dialog.sketch()
    assert (sketch.name, sketch.width_px, sketch.height_px) == ("island", 120, 80)
    assert sketch.layers["mountain"][5:35, 5:45].all()
    assert np.count_nonzero(sketch.layers["mountain"]) == 30 * 40
    assert not dialog.before.image.isNull()
    assert not dialog.after.image.isNull()

    dialog.form["name"].selectAll()
    qtbot.keyClicks(dialog.form["name"], "Far isle")
    dialog.form["size_px"].setValue(60)
    dialog.form["extent"].setValue(9000.0)
    wait_until_ready(qtbot, dialog)
    sketch = dialog.sketch()
    assert (sketch.name, sketch.extent) == ("Far isle", 9000.0)
    assert (sketch.width_px, sketch.height_px) == (60, 40)
    assert "60 × 40 px, 9 km × 6 km" in dialog.status.text()


def test_meanings_change_by_key_and_a_map_without_any_is_refused(qtbot, opened, picture):
    dialog = opened(picture)
    wait_until_ready(qtbot, dialog)
    box = dialog.colours.boxes[1]
    box.setFocus()
    while box.currentText() != "Lakes":
        before = box.currentIndex()
        qtbot.keyClick(box, Qt.Key.Key_Down)
        assert box.currentIndex() > before
    assert not dialog.create_button.isEnabled()
    wait_until_ready(qtbot, dialog)
    assert not dialog.sketch().layers["forest"].any()
    assert dialog.sketch().layers["lake"][20:70, 80:115].all()

    dialog = opened(picture)
    wait_until_ready(qtbot, dialog)
    for box in dialog.colours.boxes:
        box.setCurrentIndex(0)
    qtbot.waitUntil(lambda: "Choose what at least one" in dialog.status.text())
    assert not dialog.create_button.isEnabled()
    dialog.colours.boxes[1].setCurrentIndex(3)
    wait_until_ready(qtbot, dialog)


def test_a_grey_picture_needs_a_layer(qtbot, opened, tmp_path):
    pixels = np.zeros((64, 64), np.uint8)
    pixels[20:40, 10:50] = 255
    Image.fromarray(pixels).save(tmp_path / "mask.png")
    dialog = opened(tmp_path / "mask.png")
    wait_until_ready(qtbot, dialog)
    dialog.layer.setCurrentText("Lakes 2")
    wait_until_ready(qtbot, dialog)
    lake = dialog.sketch().layers["lake"]
    assert np.array_equal(lake == 2, pixels > 0)


def test_vectors_define_their_own_extent(qtbot, opened, tmp_path):
    path = tmp_path / "rivers.geojson"
    line = {"type": "LineString", "coordinates": [[11.0, 47.0], [11.05, 47.03]]}
    feature = {"type": "Feature", "properties": {"layer": "river"}, "geometry": line}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    dialog = opened(path)
    wait_until_ready(qtbot, dialog)
    assert dialog.before.isHidden() or not dialog.before.isVisible()
    assert not dialog.form["extent"].isEnabled()
    assert dialog.form["extent"].value() == pytest.approx(dialog.sketch().extent, abs=1.0)
    assert len(dialog.sketch().vectors["river"]) == 1
    assert (sketch_picture(dialog.sketch()) < 255).any()


def test_unreadable_pictures_are_reported_and_reading_can_be_cancelled(qtbot, opened, tmp_path, picture):
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\nbroken")
    dialog = opened(tmp_path / "a.png")
    qtbot.waitUntil(lambda: "expected a whole PNG" in dialog.status.text())
    assert not dialog.create_button.isEnabled()
    qtbot.keyClick(dialog, Qt.Key.Key_Escape)
    assert dialog.isHidden()

    dialog = opened(picture)
    dialog.reject()
    finish_reading()
    assert dialog.isHidden()
    assert not dialog.create_button.isEnabled()
