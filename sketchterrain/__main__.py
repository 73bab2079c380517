"""``python -m sketchterrain``: the command line."""

from __future__ import annotations

import sys

from sketchterrain.app.cli import main

sys.exit(main())
