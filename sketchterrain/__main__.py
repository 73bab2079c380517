"""``python -m sketchterrain``: the command line."""

from __future__ import annotations

import sys

from sketchterrain.cli import main

sys.exit(main())
