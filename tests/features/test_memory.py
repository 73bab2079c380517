"""What is remembered is what would be worked out, and no more is worked out than a stroke asks for."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.features import memory as memory_module
from sketchterrain.features import place
from sketchterrain.features.memory import ShapeMemory
from sketchterrain.sketch.document import Sketch


def squares(count: int = 4) -> Sketch:
    layers = {name: np.zeros((64, 96), np.uint8) for name in ("mountain", "hill")}
    for number in range(count):
        layers["mountain"][4:20, 4 + 22 * number : 18 + 22 * number] = 1
    layers["hill"][40:60, 10:80] = 2
    return Sketch(layers=layers)


def dabbed(sketch: Sketch, row: int, column: int) -> Sketch:
    mountain = sketch.layers["mountain"].copy()
    mountain[row : row + 3, column : column + 3] = 1
    return sketch.replace(layers={**sketch.layers, "mountain": mountain})


@pytest.fixture
def broken_up(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """First pixels of the shapes that are really broken up."""
    seen: list[int] = []
    real = memory_module.user_features

    def counted(shape, **options):
        seen.append(shape.id)
        return real(shape, **options)

    monkeypatch.setattr(memory_module, "user_features", counted)
    return seen


def test_only_what_a_stroke_changed_is_broken_up(broken_up: list[int]) -> None:
    sketch, memory = squares(), ShapeMemory()
    place(sketch, seed=1, memory=memory)
    assert len(broken_up) == 5
    place(sketch, seed=1, memory=memory)
    assert len(broken_up) == 5
    place(dabbed(sketch, 19, 30), seed=1, memory=memory)  # at the edge of the second square
    place(dabbed(sketch, 30, 30), seed=1, memory=memory)  # a shape of its own
    assert broken_up[5:] == [4 * 96 + 26, 30 * 96 + 30]


@pytest.mark.parametrize(
    "changed",
    [
        {"fidelity": 0.3},
        {"labels": {("mountain", 1): {"multitude": 9}}},
        {"labels": {("hill", 2): {"multitude": 1}}},
        {"extent": 100.0},
        {"layers": {"mountain": squares().layers["mountain"], "river": squares().layers["hill"]}},
        {"layers": {"mountain": np.ones((64, 96), np.uint8)}},
        {"layers": {"mountain": np.ones((32, 96), np.uint8)}},
    ],
)
def test_the_same_as_without_memory(changed: dict[str, object]) -> None:
    memory = ShapeMemory()
    place(squares(), seed=1, memory=memory)
    after = squares().replace(**changed)
    assert np.array_equal(place(after, seed=1, memory=memory), place(after, seed=1))
    assert np.array_equal(place(after, seed=2, memory=memory), place(after, seed=2))


def test_a_shape_elsewhere_is_another_shape() -> None:
    memory, sketch = ShapeMemory(), squares()
    place(sketch, seed=1, memory=memory)
    rolled = sketch.replace(layers={name: np.roll(image, 1, 1) for name, image in sketch.layers.items()})
    assert np.array_equal(place(rolled, seed=1, memory=memory), place(rolled, seed=1))


def test_it_forgets_the_oldest() -> None:
    memory = ShapeMemory(most=3)
    for shift in range(4):
        sketch = squares()
        moved = np.roll(sketch.layers["mountain"], shift, 0)
        place(sketch.replace(layers={"mountain": moved}), seed=1, memory=memory)
        assert len(memory) == 3
