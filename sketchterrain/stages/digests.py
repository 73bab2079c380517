"""Content digests of values: equal digests mean equal canonical bytes, in any process.

Values are scalars, strings, arrays, containers and frozen dataclasses of these; what a value is not equal
by (fields with ``compare=False``) or is computed from the rest (``init=False``) is left out. A value that has
a ``digest_parts`` method is digested by what it returns. Digests of objects are kept for as long as they
live: neither they nor read-only arrays may change.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from hashlib import blake2b
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType, MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

_SIZE: Final = 16  # bytes
_LARGE: Final = 1 << 12  # bytes of arrays whose digests are kept
_FEW: Final = 256  # objects of which as many may be gone before they are forgotten; of more, half
BLOCK: Final = 64
"""Pixels along the sides of blocks of images."""
_LITERALS: Final = frozenset({str, int, float, complex, bool, type(None)})
_SCALARS: Final = (str, bytes, int, float, complex, type(None), np.generic, PurePath)


class _Known(weakref.ref[Any]):
    """What is known of an object."""

    __slots__ = ("found",)  # there are many

    found: Any


class Memory(dict[int, _Known]):
    """What is known of objects, by id; soon after they are gone it is forgotten."""

    _limit = _FEW

    def of(self, value: object) -> Any:
        """Return what was kept of an object; None without."""
        known = self.get(id(value))
        return known.found if known is not None and known() is value else None

    def keep(self, value: object, found: object) -> None:
        """Keep what was found of an object."""
        # Without a callback: an interruption that falls into one is lost.
        self[id(value)] = known = _Known(value)
        known.found = found
        if len(self) >= self._limit:
            self.forget_gone()

    def forget_gone(self) -> None:
        """Forget objects that are gone."""
        for name, known in list(self.items()):
            if known() is None and self.get(name) is known:
                self.pop(name, None)
        self._limit = max(2 * len(self), _FEW)


_digests = Memory()
_blocks = Memory()
"""Digests of objects by id, and of the blocks of read-only images."""


def digest_of(value: object) -> bytes:
    """Return the digest of a value; raise TypeError for one that is no plain value."""
    known: bytes | None = _digests.of(value)
    if known is not None:
        return known
    found = _image_digest(value) if is_image(value) else _hashed(value)
    if not isinstance(value, np.ndarray) or not value.flags.writeable:
        remember(value, found)
    return found


def remember(value: object, digest: bytes) -> None:
    """Keep a digest for a value that need not be hashed; without effect on values that have no address."""
    if isinstance(value, np.ndarray) or is_dataclass(value) or hasattr(value, "digest_parts"):
        _digests.keep(value, digest)


def remember_parts(value: object, digest: bytes) -> None:
    """Keep a digest that identifies a value, and those of its items or fields that follow from it."""
    remember(value, digest)
    parts = [getattr(value, each.name) for each in fields(value)] if is_dataclass(value) else value
    for number, part in enumerate(parts if isinstance(parts, (tuple, list)) else ()):
        if isinstance(part, tuple):
            remember_parts(part, _hashed((digest, number)))
        elif is_dataclass(part) and _digests.of(part) is None:
            remember(part, _hashed((digest, number)))


def derive_digest(image: npt.NDArray[np.uint8], before: npt.NDArray[np.uint8], box: Sequence[int]) -> None:
    """Prepare the digest of a read-only image that differs from another in a box (top, left, bottom, right).

    Only blocks that the box meets are hashed.
    """
    if image.shape != before.shape or not is_image(before):
        return
    where = np.zeros(blocks_of(before).shape, np.bool_)
    where[max(box[0], 0) // BLOCK : -(-box[2] // BLOCK), max(box[1], 0) // BLOCK : -(-box[3] // BLOCK)] = True
    _derive_blocks(image, before, where)


def _derive_blocks(image: npt.NDArray[np.uint8], before: Any, where: npt.NDArray[np.bool_]) -> None:
    """Keep the digests of an image's blocks, which are another's but for some."""
    blocks = blocks_of(before).copy()
    blocks[where] = _hashed_blocks(image, where)
    _blocks.keep(image, blocks)


def places_of(where: npt.NDArray[np.bool_]) -> Iterator[tuple[slice, slice]]:
    """Yield the pixels of some blocks of an image."""
    for row, column in np.argwhere(where).tolist():
        yield np.s_[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK]


def patched(
    base: npt.NDArray[np.uint8] | None, shape: tuple[int, ...], where: npt.NDArray[np.bool_], data: bytearray
) -> npt.NDArray[np.uint8]:
    """Return a read-only image with the pixels of some blocks in place of another's, which else is empty."""
    image = np.zeros(shape, np.uint8) if base is None else base.copy()
    start = 0
    for place in places_of(where):
        part = image[place]
        part[:] = np.frombuffer(data, np.uint8, part.size, start).reshape(part.shape)
        start += part.size
    image.flags.writeable = False
    if base is not None:
        _derive_blocks(image, base, where)
    return image


def is_image(value: object) -> bool:
    """Return whether a value is digested by blocks: a read-only raster of bytes."""
    return (
        isinstance(value, np.ndarray)
        and value.dtype == np.uint8
        and value.ndim == 2
        and not value.flags.writeable
    )


def _image_digest(image: Any) -> bytes:
    return _hashed(("image", image.shape, blocks_of(image).tobytes()))


def blocks_of(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.void]:
    """Return the digests of the blocks of a read-only image, (rows, columns)."""
    known: npt.NDArray[np.void] | None = _blocks.of(image)
    if known is None:
        shape = [-(-side // BLOCK) for side in image.shape]
        known = _hashed_blocks(image, np.ones(shape, np.bool_)).reshape(shape)
        _blocks.keep(image, known)
    return known


def _hashed_blocks(image: npt.NDArray[np.uint8], where: npt.NDArray[np.bool_]) -> npt.NDArray[np.void]:
    """Return the digests of some blocks, (n,)."""
    parts = (image[place] for place in places_of(where))
    if not image.any():  # as most layers
        return np.array([_empty_digest(part.size) for part in parts], f"V{_SIZE}")
    return np.array([blake2b(part.tobytes(), digest_size=_SIZE).digest() for part in parts], f"V{_SIZE}")


_empty_digest = cache(lambda size: blake2b(bytes(size), digest_size=_SIZE).digest())


def _hashed(value: object) -> bytes:
    hasher = blake2b(digest_size=_SIZE)
    _feed(hasher.update, value, outermost=True)
    return hasher.digest()


def _feed(update: Callable[[Any], None], value: Any, *, outermost: bool = False) -> None:
    """Feed a value's canonical bytes; objects inside of it by their digests."""
    kind: Any = type(value)
    if kind in _LITERALS:
        update(f"{kind.__name__} {value!r};".encode())
    elif isinstance(value, np.ndarray):
        if value.nbytes <= _LARGE or outermost or value.flags.writeable:
            update(b"array %s %r;" % (_type_name(value.dtype), value.shape))
            update(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data if value.size else b"")
        else:
            update(digest_of(value))
    elif isinstance(value, _SCALARS):
        text = value if isinstance(value, bytes) else repr(value).encode()
        update(b"%s %d %s" % (kind.__name__.encode(), len(text), text))
    elif isinstance(value, (tuple, list)):
        update(b"%s %d;" % (kind.__name__.encode(), len(value)))
        for each in value:
            if type(each) in _LITERALS:  # as most: a call less
                update(f"{type(each).__name__} {each!r};".encode())
            else:
                _feed(update, each)
    elif isinstance(value, (dict, MappingProxyType)):
        _feed(update, ("items", [part for item in value.items() for part in item]))
    elif isinstance(value, (set, frozenset)):
        _feed(update, ("set", sorted(map(digest_of, value))))
    elif isinstance(value, slice):
        _feed(update, ("slice", value.start, value.stop, value.step))
    elif isinstance(value, (FunctionType, BuiltinFunctionType, type)):
        update(_name_of(value))
    elif not outermost:
        update(digest_of(value))
    elif hasattr(value, "digest_parts"):
        _feed(update, (kind, value.digest_parts()))
    elif is_dataclass(value):
        update(_name_of(kind))
        for name in _compared_fields(kind):
            _feed(update, getattr(value, name))
    else:
        raise TypeError(f"expected a plain value, got {kind.__module__}.{kind.__qualname__}")


@cache
def _name_of(value: Any) -> bytes:
    """Return the canonical bytes of a function or class."""
    if "<" in value.__qualname__:
        raise TypeError(f"expected a function of a module, got {value.__qualname__}")
    return f"name {value.__module__}.{value.__qualname__};".encode()


@cache
def _type_name(dtype: np.dtype[Any]) -> bytes:
    """Return the canonical bytes of a type of arrays."""
    if dtype.hasobject:
        raise TypeError(f"expected an array of plain values, got {dtype}")
    return str(dtype.descr if dtype.fields else dtype.str).encode()


@cache
def _compared_fields(kind: Any) -> tuple[str, ...]:
    """Return the names of a dataclass's fields: those that it is equal by, or all if it is by identity."""
    whole = not kind.__dataclass_params__.eq
    return tuple(each.name for each in fields(kind) if each.init and (whole or each.compare))
