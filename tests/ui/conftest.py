"""Fixtures of the window's tests: models, a link that records requests, Qt without a screen."""

import gc
import os
from functools import partial

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Preferences, Workspace


class FakeLink(EngineLink):
    """A link without processes; tests set its values and emit its signals."""

    def __init__(self, document):
        super().__init__(document)
        self.requests, self.running = [], False
        self.send = self.requests.append

    def start(self):
        self.running = True

    def stop(self):
        self.running = False


@pytest.fixture
def qtbot(qtbot):
    """Wait long for conditions and signals: machines are shared."""
    for name in ("waitUntil", "waitSignal", "waitSignals"):
        setattr(qtbot, name, partial(getattr(qtbot, name), timeout=300_000))
    return qtbot


@pytest.fixture(autouse=True)
def garbage_on_this_thread():
    """Collect garbage on this thread: Qt objects must not be deleted on another one."""
    gc.disable()
    yield
    gc.collect(0)
    gc.enable()


@pytest.fixture(scope="session")
def valley():
    return load_sketch("valley_river")


@pytest.fixture
def document(qapp, valley):
    return Document(valley)


@pytest.fixture
def workspace(qapp):
    return Workspace()


@pytest.fixture
def link(document):
    return FakeLink(document)


@pytest.fixture(scope="session")
def placed(valley):
    """The placement of the preset valley_river."""
    recipe = make_recipe(valley)
    fill = recipe.points.fill.within(0.0, 0.0, *valley.size)
    points = np.sort(np.concatenate([recipe.points.painted, fill]), order="id")
    return Placement(1, points, tuple(recipe.rivers), tuple(recipe.lakes))


@pytest.fixture
def show_widget(qtbot):
    """Return a function that shows a widget and holds it until the test ends."""
    widgets = []

    def show(widget, width=300, height=600):
        widgets.append(widget)
        qtbot.addWidget(widget)
        widget.resize(width, height)
        widget.show()
        return widget

    yield show
    widgets.clear()


@pytest.fixture
def open_canvas(workspace, link, show_widget):
    """Return a function that shows the canvas of a document, which records its messages as `lines`."""
    from sketchterrain.ui.canvas.canvas import Canvas

    def open_(document):
        widget = show_widget(Canvas(document, workspace, link), 500, 500)
        widget.setFocus()
        widget.lines = []
        document.message.connect(widget.lines.append)
        return widget

    return open_


@pytest.fixture
def small():
    """A sketch that exports quickly."""
    mountain = np.zeros((48, 64), np.uint8)
    mountain[10:30, 10:40] = 1
    return Sketch(name="Small", extent=512.0, layers={"mountain": mountain})


@pytest.fixture
def open_window(qtbot, document, workspace, link, tmp_path):
    """Return a factory of main windows that share preferences and recent files."""
    # Imported late: most tests do not need the whole window.
    from sketchterrain.ui.window import MainWindow

    def open_():
        window = MainWindow(document, workspace, link, Preferences(tmp_path / "desktop.ini"), tmp_path)
        # Closing must not ask about unsaved changes.
        qtbot.addWidget(
            window, before_close_func=lambda _: document.mark_saved(document.state, tmp_path / "end.sketch")
        )
        window.show()
        return window

    return open_


@pytest.fixture
def window(open_window):
    return open_window()
