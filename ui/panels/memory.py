"""How much memory this process holds."""

from __future__ import annotations

import os
import sys
from pathlib import Path

__all__ = ["own_memory"]

_STATUS = Path("/proc/self/statm")


def own_memory() -> int:
    """Return the bytes that this process holds now; where the system does not say, the most it held."""
    if _STATUS.exists():
        return int(_STATUS.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGESIZE")
    import resource  # not on every system that has no /proc

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
