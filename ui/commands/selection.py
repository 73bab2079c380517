"""What can be done with what is chosen, and adding to it: a step of the history each."""

from __future__ import annotations

from sketchterrain.ui.commands import placed_edits
from sketchterrain.ui.commands.placed_edits import name_of
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Selection, Workspace


def add(document: Document, workspace: Workspace, kind: str, x: float, y: float) -> None:
    """Add a feature at a place (m), and choose it."""
    sketch = placed_edits.added_at(document.sketch, kind, x, y)
    document.do(f"Add {kind}", sketch)
    workspace.selection = Selection("feature", sketch.edits[-1].feature or 0)


def lock(document: Document, workspace: Workspace, placed: Placement, selection: Selection) -> None:
    """Let a feature keep every value that it has, whatever is painted."""
    changed = placed_edits.locked(document.sketch, placed, selection)
    document.do(f"Lock {name_of(placed, selection)}", changed)


def unlock(document: Document, workspace: Workspace, placed: Placement, selection: Selection) -> None:
    """Let a feature follow the sketch again."""
    changed = placed_edits.unlocked(document.sketch, selection)
    document.do(f"Unlock {name_of(placed, selection)}", changed)


def reset(document: Document, workspace: Workspace, placed: Placement, selection: Selection) -> None:
    """Make something again as it was generated."""
    changed = placed_edits.reset(document.sketch, placed, selection)
    document.do(f"Reset {name_of(placed, selection)}", changed)


def delete(document: Document, workspace: Workspace, placed: Placement, selection: Selection) -> None:
    """Delete a feature, a river or a lake, and let go of it."""
    changed = placed_edits.deleted(document.sketch, selection)
    document.do(f"Delete {name_of(placed, selection)}", changed)
    workspace.selection = None


def delete_or_reset(document: Document, workspace: Workspace, placed: Placement, selection: Selection) -> str:
    """Delete what is chosen; a control point of a river goes back to where it was generated."""
    if selection.index is None:
        delete(document, workspace, placed, selection)
    elif placed_edits.is_edited(document.sketch, placed, selection):
        document.do("Reset a point of a river", placed_edits.reset(document.sketch, placed, selection))
    else:
        return "A point of a river cannot be deleted; click the river to delete all of it"
    return ""
