"""OpenEXR images of 32-bit floats, by the OpenEXR library."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.whole_files import whole_path

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy.typing as npt

__all__ = ["write_exr"]


def write_exr(
    path: Path,
    channels: Mapping[str, npt.NDArray[np.float32]],
    *,
    comment: str | None = None,
    attributes: Mapping[str, Any] | None = None,
) -> Path:
    """Write an image, its scan lines from the upper edge on, losslessly compressed (ZIP, 16 lines a block).

    The same values give the same bytes.

    Parameters
    ----------
    path
    channels
        (rows, columns) float32 each, by name: ``R``, ``G``, ``B``, ``A`` are colours, ``Y`` is the one
        channel of a grey image. Bits stay as they are, those of NaN too.
    comment
        The standard attribute ``comments``.
    attributes
        Others of the header.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    SketchterrainError
        If the system cannot write the file; the old one, if any, is as it was.
    """
    import OpenEXR

    header: dict[str, Any] = dict(attributes or {})
    header |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if comment is not None:
        header["comments"] = comment
    # The library reads memory in rows whatever an array's strides are.
    planes = {name: np.ascontiguousarray(plane, np.float32) for name, plane in channels.items()}
    with whole_path(path) as temporary:
        try:
            OpenEXR.File(header, planes).write(str(temporary))
        except RuntimeError as error:  # 'Failed to … file "…". No space left on device.'
            raise OSError(str(error).rpartition('". ')[2].rstrip(".")) from error
    return path
