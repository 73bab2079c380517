"""What can be done with what is chosen, and adding to it: a step of the history each."""

from __future__ import annotations

from sketchterrain.ui.commands import placed_edits
from sketchterrain.ui.commands.placed_edits import name_of
from sketchterrain.ui.engine.protocol import Placed
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Chosen, Workspace


def add(document: Document, workspace: Workspace, kind: str, x: float, y: float) -> None:
    """Add a feature at a place (m), and choose it."""
    sketch = placed_edits.added_at(document.sketch, kind, x, y)
    document.do(f"Add {kind}", sketch)
    workspace.chosen = Chosen("feature", sketch.edits[-1].feature or 0)


def lock(document: Document, workspace: Workspace, placed: Placed, chosen: Chosen) -> None:
    """Let a feature keep every value that it has, whatever is painted."""
    changed = placed_edits.locked(document.sketch, placed, chosen)
    document.do(f"Lock {name_of(placed, chosen)}", changed)


def unlock(document: Document, workspace: Workspace, placed: Placed, chosen: Chosen) -> None:
    """Let a feature follow the sketch again."""
    changed = placed_edits.unlocked(document.sketch, chosen)
    document.do(f"Unlock {name_of(placed, chosen)}", changed)


def reset(document: Document, workspace: Workspace, placed: Placed, chosen: Chosen) -> None:
    """Make something again as it was generated."""
    changed = placed_edits.reset(document.sketch, placed, chosen)
    document.do(f"Reset {name_of(placed, chosen)}", changed)


def delete(document: Document, workspace: Workspace, placed: Placed, chosen: Chosen) -> None:
    """Delete a feature, a river or a lake, and let go of it."""
    changed = placed_edits.deleted(document.sketch, chosen)
    document.do(f"Delete {name_of(placed, chosen)}", changed)
    workspace.chosen = None


def delete_or_reset(document: Document, workspace: Workspace, placed: Placed, chosen: Chosen) -> str:
    """Delete what is chosen; a control point of a river goes back to where it was generated."""
    if chosen.index is None:
        delete(document, workspace, placed, chosen)
    elif placed_edits.is_edited(document.sketch, placed, chosen):
        document.do("Reset a point of a river", placed_edits.reset(document.sketch, placed, chosen))
    else:
        return "A point of a river cannot be deleted; click the river to delete all of it"
    return ""
