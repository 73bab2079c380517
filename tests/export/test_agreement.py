"""Relief shading of the adherence picture."""

from types import SimpleNamespace

import numpy as np

from sketchterrain.export.agreement import _hillshade


def test_a_tilted_plane_has_the_brightness_of_lamberts_law() -> None:
    sketch = SimpleNamespace(pixel_size=4.0, width_px=6, height_px=5)
    sun = np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])
    for east, north in ((0.0, 0.0), (0.5, 0.0), (0.0, -0.75), (-1.5, 2.0), (3.0, -3.0)):
        terrain = SimpleNamespace(
            sketch=sketch, heights=lambda x, y, cell_size, e=east, n=north: e * x + n * y + 7.0
        )
        normal = np.array([-east, -north, 1.0]) / np.linalg.norm([east, north, 1.0])
        expected = 60.0 + 185.0 * max(normal @ sun, 0.0)
        np.testing.assert_allclose(_hillshade(terrain), np.full((5, 6), expected), rtol=1e-5)
