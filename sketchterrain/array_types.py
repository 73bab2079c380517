"""Type aliases of NumPy arrays and rectangles."""

import numpy as np
from numpy import typing as npt

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
FloatArray = npt.NDArray[np.floating]
Int32Array = npt.NDArray[np.int32]
Int64Array = npt.NDArray[np.int64]
UInt8Array = npt.NDArray[np.uint8]
BoolArray = npt.NDArray[np.bool_]
StructuredArray = npt.NDArray[np.void]
LatticeArray = npt.NDArray[np.int64]  # lattice coordinates: integer multiples of extent / 2**24 m
Bounds = tuple[float, float, float, float]  # west, south, east, north (m)
