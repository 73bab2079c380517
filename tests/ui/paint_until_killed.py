"""A program without a window that paints, changes settings, undoes and saves until it is killed.

It logs each state of the document, before other listeners see it, the start and end of saves and the end of
autosaves: event, fingerprint of the sketch.
"""

import hashlib
import os
import random
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PyQt6.QtCore import QCoreApplication, QTimer

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.document.toml_format import settings_text
from sketchterrain.schema.layers import PAINTED_LAYERS
from sketchterrain.ui.models.background import Autosave, SketchSaver
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.painting import Stroke


def fingerprint(sketch: Sketch) -> str:
    """Return a hash of everything in a sketch."""
    digest = hashlib.sha1(settings_text(sketch).encode(), usedforsecurity=False)
    for name in PAINTED_LAYERS:
        digest.update(sketch.layers[name].tobytes())
    return digest.hexdigest()


class LoggedAutosave(Autosave):
    """Logs what it has written."""

    def __init__(self, *given: Any, log: Callable[[str, Sketch], None], **named: Any) -> None:
        super().__init__(*given, **named)
        self._log = log

    def _write(self, sketch: Sketch, *given: Any) -> None:
        super()._write(sketch, *given)
        self._log("autosaved", sketch)


class Painter:
    """Performs a random document action every 3 ms."""

    def __init__(self, target: Path, folder: Path, log: Path, *, interval_s: float, seed: int) -> None:
        self._file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self._target = target
        self._random = random.Random(seed)
        self._document = Document(Sketch(layers={"hill": np.zeros((300, 420), dtype=np.uint8)}))
        self._document.sketch_changed.connect(lambda: self._log_sketch("state", self._document.sketch))
        self._saving = SketchSaver(self._document)
        self._saving.saved.connect(lambda: self._log_sketch("saved", self._being_saved))
        self._autosave = LoggedAutosave(self._document, folder, interval_s=interval_s, log=self._log_sketch)
        self._being_saved = self._document.sketch
        recoveries = self._autosave.recoverable()
        if recoveries:
            self._document.open(load_sketch(recoveries[0].path), recoveries[0].original, modified=True)
            for recovery in recoveries:
                self._autosave.discard(recovery)
        elif target.exists():
            self._document.open(load_sketch(target), target)
        else:
            self._log_sketch("state", self._document.sketch)
        self._stroke: Stroke | None = None
        self._timer = QTimer()
        self._timer.timeout.connect(self._act)
        self._timer.start(3)

    def _log_sketch(self, event: str, sketch: Sketch) -> None:
        os.write(self._file, f"{event} {fingerprint(sketch)}\n".encode())

    def _act(self) -> None:
        draft = self._document.draft
        if self._stroke is not None and draft is not None:
            if self._random.random() < 0.8:
                place = self._random.uniform(0, 420), self._random.uniform(0, 300)
                box = self._stroke.to(*place, self._random.uniform(1, 30))
                if box:
                    draft.touch(box)
                return
            draft.commit("Paint")
            self._stroke = None
            return
        choice = self._random.random()
        if choice < 0.5:
            draft = self._document.begin_draft(self._random.choice(list(PAINTED_LAYERS)))
            self._stroke = Stroke(draft.image, self._random.randrange(5))
        elif choice < 0.6:
            sketch = self._document.sketch
            self._document.do("Set seed", sketch.replace(seed=self._random.randrange(10**6)))
        elif choice < 0.75:
            self._document.undo()
        elif choice < 0.85:
            self._document.redo()
        elif choice < 0.865 and not self._saving.is_busy:
            self._being_saved = self._document.sketch
            self._log_sketch("saving", self._being_saved)
            self._saving.save(self._target)


if __name__ == "__main__":
    application = QCoreApplication([])
    painter = Painter(*map(Path, sys.argv[1:4]), interval_s=float(sys.argv[4]), seed=int(sys.argv[5]))
    sys.exit(application.exec())
