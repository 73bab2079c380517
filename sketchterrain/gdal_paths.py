"""Paths as the libraries around GDAL read them: not each name of a file is one to them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def plain_path(path: Path) -> Iterator[Path]:
    """Yield a path by which pyogrio finds a file, or makes one, whatever its name is.

    pyogrio takes a ``!`` for the end of an archive's name, and an ending ``.zip`` for an archive
    (`pyogrio.util.vsi_path`): it would read or write another file. Such a file is reached by a link.
    """
    whole = path.absolute()
    if "!" not in str(whole) and whole.suffix != ".zip":
        yield whole
        return
    with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
        link = Path(folder) / "map.gpkg"
        link.symlink_to(whole)
        yield link
