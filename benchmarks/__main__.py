"""``python -m sketchterrain.benchmarks``: the same as ``sketchterrain bench``."""

import sys

from sketchterrain.app.cli import main

if __name__ == "__main__":
    sys.exit(main(["bench", *sys.argv[1:]]))
