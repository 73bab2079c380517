"""A world's window as a program of its own."""

from __future__ import annotations

from pathlib import Path

from sketchterrain.ui.screen import check_screen

__all__ = ["run"]


def run(path: str | Path, *, device: str | None = None) -> int:
    """Show a world until its window is closed.

    Parameters
    ----------
    path
        What was written.
    device
        Selector as for :func:`~sketchterrain.compute.choose_device`.

    Returns
    -------
    int
        The exit code.

    Raises
    ------
    InputError
        If there is no such world; before any window.
    SketchterrainError
        If there is no screen, or Qt lacks something.
    """
    check_screen()
    from sketchterrain.world.opening import open_world

    open_world(path)
    from sketchterrain.ui.application import Garbage, delete_window, named_application
    from sketchterrain.ui.look.theme import apply_theme
    from sketchterrain.ui.models.preferences import Preferences, config_folder
    from sketchterrain.ui.worlds.window import WorldWindow

    app = named_application()
    preferences = Preferences(config_folder() / "desktop.ini")
    apply_theme(app, preferences.theme)
    window = WorldWindow(Path(path).absolute(), device=device or preferences.device)
    window.show()
    garbage = Garbage()
    code = app.exec()
    window.link.stop()
    delete_window(window)
    garbage.end()
    return code
