"""How much is painted with each label: counted a slice at a time, so that a large sketch stops nothing."""

from __future__ import annotations

from collections.abc import Mapping

from PyQt6.QtCore import QObject, QTimer, pyqtSignal

from sketchterrain.sketch.document import LabelImage
from sketchterrain.ui.commands.labels import label_areas

_SLICE = 1 << 20  # px: a few ms


class AreaCount(QObject):
    """Counts label images; the newest of a layer counts."""

    counted = pyqtSignal(str, object)
    """A layer, and pixels by label."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._images: dict[str, LabelImage] = {}
        self._waiting: dict[str, tuple[int, dict[int, int]]] = {}
        self._timer = QTimer(self)
        self._timer.setInterval(0)
        self._timer.timeout.connect(self._go_on)

    def count(self, layers: Mapping[str, LabelImage]) -> None:
        """Count those layers whose images are others than before."""
        for name, image in layers.items():
            if self._images.get(name) is image:
                continue
            self._images[name] = image
            self._waiting[name] = (0, {})
            if image.size <= _SLICE:
                self._count_slice(name)
        if self._waiting:
            self._timer.start()

    def _go_on(self) -> None:
        name = next(iter(self._waiting), None)
        if name is None:
            self._timer.stop()
        else:
            self._count_slice(name)

    def _count_slice(self, name: str) -> None:
        image = self._images[name]
        top, areas = self._waiting[name]
        bottom = top + max(1, _SLICE // image.shape[1])
        for label, pixels in label_areas(image[top:bottom]).items():
            areas[label] = areas.get(label, 0) + pixels
        if bottom < image.shape[0]:
            self._waiting[name] = (bottom, areas)
        else:
            del self._waiting[name]
            self.counted.emit(name, areas)
