"""Films: frames in a folder, an animated image or a video, written completely or not at all."""

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

from PIL import Image

from sketchterrain.array_types import UInt8Array
from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.export.files import move_files, prepare_folder, staging, write_png
from sketchterrain.io.files import wrap_os_errors

ANIMATED: Final[dict[str, dict[str, Any]]] = {".webp": {"quality": 85, "method": 2}, ".gif": {"loop": 0}}
"""Suffixes of animated images, and Pillow's options for them."""
VIDEO: Final = ".mp4"
_CRF = "18"  # constant quality of x264 without visible loss
_BT709, _LIMITED = 1, 1  # FFmpeg's numbers for the colours of HD video
_DIGITS = 4


def check_film(path: Path, *, size: tuple[int, int], frames: int) -> None:
    """Raise now, rather than after the work, if a film could not be written.

    `path` has a suffix of `ANIMATED` or `VIDEO`, or is a folder for ``0000.png`` …; `size` is width, height.
    """
    if _is_folder(path):
        prepare_folder(path)
        last = _frame_name(frames - 1, frames)
        old = sorted(frame.name for frame in path.iterdir() if re.fullmatch(r"\d{4,}\.png", frame.name))
        more = [name for name in old if len(name) != len(last) or name > last]
        if more:
            raise InputError(
                f"{one_line(path)}: holds frames of a longer film, {more[0]} to {more[-1]}: delete them or "
                "name another folder"
            )
        return
    if path.suffix.lower() == VIDEO:
        _load_av()
        if size[0] % 2 or size[1] % 2:
            raise InputError(f"expected even sides for an {VIDEO}, got {size[0]}×{size[1]} pixels")
    prepare_folder(path.parent)


@contextmanager
def film(
    path: Path, *, size: tuple[int, int], fps: int, frames: int
) -> Iterator[Callable[[UInt8Array], None]]:
    """Yield a function that adds frames, (height, width, 3) sRGB; the film appears when all are written."""
    folder = path if _is_folder(path) else path.parent
    prepare_folder(folder)
    with staging(folder) as hidden:
        files: list[Path] = []
        if folder == path:
            yield lambda frame: files.append(write_png(hidden / _frame_name(len(files), frames), frame))
        else:
            write = _video if path.suffix.lower() == VIDEO else _animation
            with write(hidden / path.name, size, fps) as add:
                yield add
            files.append(hidden / path.name)
            with files[0].open("rb") as stream:
                os.fsync(stream.fileno())
        move_files(folder, files)


def _is_folder(path: Path) -> bool:
    return path.is_dir() or path.suffix.lower() not in {*ANIMATED, VIDEO}


def _frame_name(number: int, frames: int) -> str:
    return f"{number:0{max(_DIGITS, len(str(frames - 1)))}}.png"


@contextmanager
def _animation(path: Path, size: tuple[int, int], fps: int) -> Iterator[Callable[[UInt8Array], None]]:
    """Store the frames as files, then encode them one at a time, in constant memory."""
    files: list[Path] = []
    yield lambda frame: files.append(write_png(path.parent / f"{len(files)}.png", frame))
    # Durations are whole ms or hundredths of a second: rounding the end of each frame preserves the length.
    unit = 10 if path.suffix.lower() == ".gif" else 1
    ends = [round(1000 / unit * (number + 1) / fps) * unit for number in range(len(files))]
    durations = [end - before for before, end in zip([0, *ends], ends, strict=False)]
    sequence = _FileSequence(files, size)
    with wrap_os_errors(path):
        sequence.save(path, save_all=True, duration=durations, **ANIMATED[path.suffix.lower()])


class _FileSequence(Image.Image):
    """Image files as the frames of one Pillow image, loaded when Pillow seeks to them."""

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
def _video(path: Path, size: tuple[int, int], fps: int) -> Iterator[Callable[[UInt8Array], None]]:
    av = _load_av()
    try:
        with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
            stream = container.add_stream("libx264", rate=Fraction(fps), options={"crf": _CRF})
            stream.width, stream.height = size
            stream.pix_fmt = "yuv420p"
            codec = stream.codec_context
            codec.colorspace = codec.color_primaries = codec.color_trc = _BT709
            codec.color_range = _LIMITED

            def add(frame: UInt8Array) -> None:
                image = av.VideoFrame.from_ndarray(frame, format="rgb24")
                container.mux(stream.encode(image.reformat(format="yuv420p", dst_colorspace=_BT709)))

            yield add
            container.mux(stream.encode(None))
    except av.error.FFmpegError as error:
        raise SketchterrainError(f"{path}: cannot be written ({one_line(error)})") from error


def _load_av() -> Any:
    try:
        import av
    except ImportError as error:
        raise SketchterrainError(
            f"an {VIDEO} needs PyAV: pip install 'sketchterrain[video]', or use .webp or a folder"
        ) from error
    return av
