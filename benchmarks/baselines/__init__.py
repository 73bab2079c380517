"""What this program is compared with: other ways to the same, each small, each as its authors would have it.

- :mod:`~sketchterrain.benchmarks.baselines.noise`: the same noise as a plain loop in C (``noise.c``), in
  arrays, and FastNoise2's simplex fBm, from its shared library.
- :mod:`~sketchterrain.benchmarks.baselines.thesis`: tiles as in Zaaijer 2013 (``thesis.cl``).
"""
