"""Undo and redo of everything: the sketches that a person went through, one step a stroke."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Hashable

    from sketchterrain.sketch.document import Sketch

__all__ = ["History"]


class History:
    """The steps that led to a sketch, and those that were undone.

    Parameters
    ----------
    sketch
        Where it begins.
    """

    def __init__(self, sketch: Sketch) -> None:
        self._sketches = [sketch]
        self._titles = ["Open"]
        self._at = 0
        self._merge: Hashable | None = None

    @property
    def sketch(self) -> Sketch:
        """The sketch as it is now."""
        return self._sketches[self._at]

    @property
    def titles(self) -> tuple[str, ...]:
        """What each step did, the first is where it begins; undone ones too."""
        return tuple(self._titles)

    @property
    def position(self) -> int:
        """Which of `titles` is the last one that is done."""
        return self._at

    def do(self, title: str, sketch: Sketch, *, merge: Hashable | None = None) -> None:
        """Add a step; those that were undone are forgotten.

        Parameters
        ----------
        title
            What it does, for a person: ``"Paint mountains"``.
        sketch
            What it leads to.
        merge
            Steps that follow one another with an equal key are one step: a slider that is dragged.
        """
        if merge is not None and merge == self._merge and self._at == len(self._titles) - 1 > 0:
            self._sketches[self._at] = sketch
            return
        del self._sketches[self._at + 1 :], self._titles[self._at + 1 :]
        self._sketches.append(sketch)
        self._titles.append(title)
        self._at += 1
        self._merge = merge

    def go_to(self, position: int) -> Sketch:
        """Undo or redo until a step is the last one that is done; return the sketch.

        Raises
        ------
        IndexError
            If there is no such step.
        """
        if not 0 <= position < len(self._titles):
            raise IndexError(f"step {position}: expected 0 to {len(self._titles) - 1}")
        self._at = position
        self._merge = None
        return self.sketch
