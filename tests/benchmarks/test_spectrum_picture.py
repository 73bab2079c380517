"""The picture of spectra is drawn, with a row for each way."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from sketchterrain.benchmarks import spectrum_picture

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.benchmarks.timing import TimedContext

pytest.importorskip("matplotlib")


def test_picture_is_written(tmp_path: Path) -> None:
    path = tmp_path / "spectrum.png"
    assert spectrum_picture.main([str(path)], sets=2) == 0
    with Image.open(path) as picture:
        shown = np.asarray(picture.convert("RGB"))
    assert shown.std() > 10
    # The colours of lines outlive the few colours that a small file has.
    blue = (shown[..., 2].astype(int) - shown[..., 0]) > 100
    assert blue.sum() > 1000


def test_every_way_covers_the_square_that_is_measured(context: TimedContext) -> None:
    for name, scatter in spectrum_picture.ways(context).items():
        points = scatter(1)
        assert points.dtype == np.float64, name
        assert points.min() < 1.5, name
        assert points.max() > 70.5, name
