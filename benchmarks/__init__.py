"""Speed and accuracy, measured: tables and charts of one against the other.

``sketchterrain bench`` and ``python -m sketchterrain.benchmarks`` both call :func:`run`.
"""

from sketchterrain.benchmarks.command import run
from sketchterrain.benchmarks.registry import BENCHMARKS, Benchmark

__all__ = ["BENCHMARKS", "Benchmark", "run"]
