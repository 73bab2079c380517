"""A small sketch on disk, and the command line called in this process."""

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main

import sketchterrain.jobs.export
from sketchterrain.app.cli import main
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import save_sketch
from sketchterrain.generation import building
from sketchterrain.generation.terrain import Terrain
from sketchterrain.stages.runner import Results


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str

    @property
    def error(self) -> str:
        """The one error line; besides it only titles of slow stages are allowed."""
        assert "Traceback" not in self.err
        lines = [line for line in self.err.splitlines() if not line.endswith(" …")]
        assert len(lines) == 1, self.err
        assert lines[0].startswith("sketchterrain: error: ")
        return lines[0].removeprefix("sketchterrain: error: ")


def small_sketch() -> Sketch:
    mountain, river, forest = (np.zeros((48, 64), np.uint8) for _ in range(3))
    mountain[4:16, 48:60] = 1
    river[24:27, :40] = 1
    forest[34:46, 6:30] = 1
    return Sketch(
        name="North-east",
        extent=512.0,
        seed=5,
        ground={"relief": 5.0},
        density={"hill": 8.0},
        layers={"mountain": mountain, "river": river, "forest": forest},
        labels={("mountain", 1): {"height": 250.0}},
    )


PLACED = Results()


@pytest.fixture(scope="module", autouse=True)
def shared_between_commands() -> Iterator[None]:
    """Let commands share the parser and one cache of placed features, as the terrains of a batch do."""

    def build(sketch: Sketch, *, memory: Results, **options: Any) -> Terrain:
        return building.build(sketch, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", cache(typer.main.get_command))
        patch.setattr(building, "Results", lambda **_: PLACED)
        patch.setattr(sketchterrain.jobs.export, "build", build)
        yield


@pytest.fixture(scope="session")
def sketch(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("sketches") / "north_east"
    save_sketch(small_sketch(), path)
    return path


@pytest.fixture
def call(capfd) -> Callable[..., Outcome]:
    def run(*arguments: object) -> Outcome:
        capfd.readouterr()
        code = main([str(argument) for argument in arguments])
        return Outcome(code, *capfd.readouterr())

    return run


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """Return a stream that is a terminal, in place of stderr."""

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for name, value in (("TERM", "xterm"), ("COLUMNS", "200")):
        monkeypatch.setenv(name, value)
    return Terminal()
