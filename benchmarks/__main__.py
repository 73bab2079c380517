"""``python -m sketchterrain.benchmarks``: the same as ``sketchterrain bench``."""

import argparse
import sys
from pathlib import Path

from sketchterrain.benchmarks.command import run
from sketchterrain.benchmarks.registry import BENCHMARKS
from sketchterrain.errors import SketchterrainError


def _main() -> int:
    parser = argparse.ArgumentParser(prog="python -m sketchterrain.benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(BENCHMARKS)}; all if none")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="write bench.md, bench.json, charts")
    parser.add_argument("--quick", action="store_true", help="small sizes, few rounds: under a minute")
    parser.add_argument("--device", help="index, or a part of a device's or platform's name")
    parser.add_argument("--json", action="store_true", help="raw numbers to stdout")
    given = parser.parse_args()
    try:
        return run(
            given.names, output=given.output, quick=given.quick, device=given.device, as_json=given.json
        )
    except SketchterrainError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code


if __name__ == "__main__":
    sys.exit(_main())
