"""What a library of clusters logs, kept off the terminal: what matters is told in lines of our own."""

from __future__ import annotations

import logging
import os
import warnings
from contextlib import contextmanager
from typing import TYPE_CHECKING

from sketchterrain.exit_codes import DEBUG

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["LEVEL", "quiet"]

LEVEL = logging.CRITICAL + 1
_CHATTY = ("distributed", "tornado", "asyncio", "bokeh")


@contextmanager
def quiet() -> Iterator[None]:
    """Log nothing of dask's within this context, unless ``SKETCHTERRAIN_DEBUG`` is set."""
    if os.environ.get(DEBUG):
        yield
        return
    import distributed  # noqa: F401 - its loggers are there only then

    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] in _CHATTY]
    before = {name: logging.getLogger(name).level for name in {*names, *_CHATTY}}
    for name in before:
        logging.getLogger(name).setLevel(LEVEL)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="(distributed|dask|tornado)")
            yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)
