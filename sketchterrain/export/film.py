"""Films: frames in a folder, an animated picture or a video; all of it or nothing."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.export.files import move_into, prepare_folder, staging, write_png
from sketchterrain.whole_files import wrap_os_errors

Frame = npt.NDArray[np.uint8]
ANIMATED: Final[dict[str, dict[str, Any]]] = {".webp": {"quality": 85, "method": 2}, ".gif": {"loop": 0}}
"""Endings of animated pictures, with the options that they are written with."""
VIDEO: Final = ".mp4"
"""Ending of a video, which PyAV writes."""
_CRF = "18"  # x264's constant quality: no loss that one sees
_BT709, _LIMITED = 1, 1  # FFmpeg's numbers for the colours of HD video
_DIGITS = 4


def check_film(path: Path, *, size: tuple[int, int], frames: int) -> None:
    """Refuse now, and not after the work, what could not be written.

    Parameters
    ----------
    path
        A file named as `ANIMATED` or `VIDEO` says, else a folder for ``0000.png`` and so on.
    size
        Width and height, pixels.
    frames
        How many there will be.

    Raises
    ------
    InputError
        If a video's sides are odd, or the folder holds frames that would not be written over.
    SketchterrainError
        If PyAV is missing, or the system cannot write there.
    """
    ending = path.suffix.lower()
    if path.is_dir() or ending not in {*ANIMATED, VIDEO}:
        prepare_folder(path)
        last = _name(frames - 1, frames)
        old = sorted(each.name for each in path.iterdir() if re.fullmatch(r"\d{4,}\.png", each.name))
        more = [name for name in old if len(name) != len(last) or name > last]
        if more:
            raise InputError(
                f"{one_line(path)}: holds frames of a longer film, {more[0]} to {more[-1]}: delete them or "
                "name another folder"
            )
        return
    if ending == VIDEO:
        _load_av()
        if size[0] % 2 or size[1] % 2:
            raise InputError(f"expected even sides for an {VIDEO}, got {size[0]}×{size[1]} pixels")
    prepare_folder(path.parent)


@contextmanager
def film(path: Path, *, size: tuple[int, int], fps: int, frames: int) -> Iterator[Callable[[Frame], None]]:
    """Yield what takes the frames one after the other; then all of the film is at its place.

    If anything fails or is interrupted, nothing of it is.

    Parameters
    ----------
    path, size, frames
        As for `check_film`.
    fps
        Frames a second.

    Yields
    ------
    callable
        Takes (height, width, 3) uint8, sRGB, row 0 on top.

    Raises
    ------
    SketchterrainError
        If the system cannot write there.
    """
    ending = path.suffix.lower()
    if path.is_dir() or ending not in {*ANIMATED, VIDEO}:
        prepare_folder(path)
        with staging(path) as hidden:
            files: list[Path] = []
            yield lambda frame: files.append(write_png(hidden / _name(len(files), frames), frame))
            move_into(path, files)
        return
    prepare_folder(path.parent)
    with staging(path.parent) as hidden:
        write = _video if ending == VIDEO else _animation
        with write(hidden / path.name, size, fps) as add:
            yield add
        with (hidden / path.name).open("rb") as stream:
            os.fsync(stream.fileno())
        move_into(path.parent, [hidden / path.name])


def _name(number: int, frames: int) -> str:
    return f"{number:0{max(_DIGITS, len(str(frames - 1)))}}.png"


@contextmanager
def _animation(path: Path, size: tuple[int, int], fps: int) -> Iterator[Callable[[Frame], None]]:
    """Keep the frames as files, then encode them one at a time: all of them need not fit the memory."""
    files: list[Path] = []
    yield lambda frame: files.append(write_png(path.parent / f"{len(files)}.png", frame))
    # Formats count whole ms or hundredths of a second: rounding each end keeps the length.
    unit = 10 if path.suffix.lower() == ".gif" else 1
    ends = [round(1000 / unit * (number + 1) / fps) * unit for number in range(len(files))]
    durations = [end - before for before, end in zip([0, *ends], ends, strict=False)]
    sequence = _Sequence(files, size)
    with wrap_os_errors(path):
        sequence.save(path, save_all=True, duration=durations, **ANIMATED[path.suffix.lower()])


class _Sequence(Image.Image):
    """Image files as the frames of one image, of which Pillow asks for one after the other."""

    def __init__(self, files: list[Path], size: tuple[int, int]) -> None:
        super().__init__()
        self._files = files
        self._mode, self._size = "RGB", size
        self.n_frames, self.is_animated = len(files), len(files) > 1
        self.seek(0)

    def seek(self, frame: int) -> None:
        if not 0 <= frame < len(self._files):
            raise EOFError
        self._frame = frame
        with Image.open(self._files[frame]) as image:
            self.im = image.convert("RGB").im

    def tell(self) -> int:
        return self._frame


@contextmanager
def _video(path: Path, size: tuple[int, int], fps: int) -> Iterator[Callable[[Frame], None]]:
    av = _load_av()
    try:
        with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
            stream = container.add_stream("libx264", rate=Fraction(fps), options={"crf": _CRF})
            stream.width, stream.height = size
            stream.pix_fmt = "yuv420p"
            coder = stream.codec_context
            coder.colorspace = coder.color_primaries = coder.color_trc = _BT709
            coder.color_range = _LIMITED

            def add(frame: Frame) -> None:
                picture = av.VideoFrame.from_ndarray(frame, format="rgb24")
                container.mux(stream.encode(picture.reformat(format="yuv420p", dst_colorspace=_BT709)))

            yield add
            container.mux(stream.encode(None))
    except av.error.FFmpegError as error:
        raise SketchterrainError(f"{path}: cannot be written ({one_line(error)})") from error


def _load_av() -> Any:
    try:
        import av
    except ImportError as error:
        raise SketchterrainError(
            f"an {VIDEO} needs PyAV: pip install 'sketchterrain[video]', or take .webp or a folder"
        ) from error
    return av
