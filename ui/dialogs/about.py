"""What the program is, what it runs on, whose work it builds on."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

from PyQt6.QtCore import PYQT_VERSION_STR, Qt, qVersion
from PyQt6.QtWidgets import QDialog, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from sketchterrain.ui.dialogs.sheet import button_row, column, fix_width, form, heading, note
from sketchterrain.ui.engine.protocol import EngineFacts
from sketchterrain.ui.look.icons import app_picture
from sketchterrain.ui.look.theme import MARGIN, SMALL

_SAID = "Paint a rough sketch, get a seamless terrain that does what the sketch says."
_PAPERS = (
    "R. Zaaijer, Semi-procedural terrain from sketches, thesis, 2013",
    "E. Bruneton, F. Neyret, Real-time rendering and editing of vector-based terrains, 2008",
    "K. Perlin, Noise hardware (simplex noise), 2001",
    "F. Losasso, H. Hoppe, Geometry clipmaps, 2004",
    "R. Bridson, Fast Poisson disk sampling in arbitrary dimensions, 2007",
)


class AboutDialog(QDialog):
    """Version, device, licences, papers."""

    def __init__(self, facts: EngineFacts, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        rows = column(self, "About Sketchterrain")
        head = QHBoxLayout()
        head.setSpacing(MARGIN)
        picture = QLabel()
        picture.setPixmap(app_picture(72, self.devicePixelRatioF()))
        head.addWidget(picture)
        words = QVBoxLayout()
        words.setSpacing(SMALL)
        words.addStretch(1)
        words.addWidget(heading(f"Sketchterrain {_version('sketchterrain')}"))
        words.addWidget(note(_SAID))
        words.addStretch(1)
        head.addLayout(words, 1)
        rows.addLayout(head)
        runs_on = form()
        for title, said in _facts(facts).items():
            label = QLabel(said)
            label.setWordWrap(True)
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            name = note(title)
            name.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignTop)
            runs_on.addRow(name, label)
        rows.addLayout(runs_on)
        rows.addWidget(
            note(
                "Free software under the GNU General Public License, version 3 or later. Its window is made "
                "with PyQt (GPL 3) and Qt (LGPL 3)."
            )
        )
        papers = "".join(f"<li>{paper}</li>" for paper in _PAPERS)
        rows.addWidget(note(f"It builds on<ul style='margin-left: -18px'>{papers}</ul>"))
        rows.addStretch(1)
        rows.addWidget(button_row(self, "", cancel="Close")[0])
        fix_width(self, 520)


def _facts(facts: EngineFacts) -> dict[str, str]:
    """Return what the program runs on, by what it is."""
    sharing = {
        "extension": "shared memory of OpenCL and OpenGL",
        "mapped": "memory that both map",
        "copy": "a copy in main memory",
    }
    said = {
        "OpenCL": f"{facts.device} ({facts.platform})"
        if facts.device
        else facts.no_device or "not yet known",
        "OpenGL": facts.renderer or facts.no_picture or "not yet known",
        "Heights travel by": sharing.get(facts.sharing, ""),
        "Python, Qt": f"PyQt {PYQT_VERSION_STR}, Qt {qVersion()}",
    }
    return {title: text for title, text in said.items() if text}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from a folder that was never installed
        return ""
