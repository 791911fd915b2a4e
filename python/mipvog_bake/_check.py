"""Checks arguments, so that a wrong one raises `Error` instead of a NumPy exception."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any, Optional, Protocol, Union

import numpy as np
import numpy.typing as npt

from ._error import Error

PathName = Union[str, "os.PathLike[str]"]


class ReadableFile(Protocol):
    """A binary file that is open for reading."""

    def read(self) -> bytes: ...


class Writable(Protocol):
    """A binary file that is open for writing."""

    def write(self, data: bytes, /) -> Any: ...


# Bytes, or what they can be read from.
Readable = Union[bytes, bytearray, memoryview, ReadableFile]


def data(name: str, value: Any) -> Optional[bytes]:
    """The bytes of a bytes-like object or a binary file; None for anything else, such as a path."""
    if isinstance(value, (bytes, bytearray, memoryview)):
        return bytes(value)
    read = getattr(value, "read", None)
    if read is None:
        return None
    found = read()
    if not isinstance(found, bytes):
        kind = type(found).__name__
        raise Error(f"{name}: found a file that gives {kind}, expected one of bytes (mode 'rb')")
    return found


def path(name: str, value: Any) -> str:
    """A path as a string."""
    try:
        return os.fsdecode(value)
    except (TypeError, UnicodeDecodeError) as error:
        raise Error(f"{name}: found {type(value).__name__}, expected a path") from error


def function(name: str, value: Any) -> Any:
    """A callable."""
    if not callable(value):
        raise Error(f"{name}: found {type(value).__name__}, expected a function")
    return value


def whole(name: str, value: Any, expected: str, least: int = 0, most: Optional[int] = None) -> int:
    """An integer from `least` to `most`."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    is_whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not is_whole or value < least or (most is not None and value > most):
        raise Error(f"{name}: found {value!r}, expected {expected}")
    return int(value)


def number(name: str, value: Any, expected: str, above: float = -math.inf) -> float:
    """A finite number greater than another."""
    try:
        found = float(value)
    except (TypeError, ValueError) as error:
        raise Error(f"{name}: found {value!r}, expected {expected}") from error
    if not math.isfinite(found) or found <= above:
        raise Error(f"{name}: found {value!r}, expected {expected}")
    return found


def numbers(name: str, value: Any, expected: str) -> npt.NDArray[np.float64]:
    """Real numbers of any shape."""
    try:
        found = np.asarray(value)
    except (TypeError, ValueError, RuntimeError) as error:
        words = f"{type(value).__name__} that NumPy cannot read"
        raise Error(f"{name}: found {words}, expected {expected}") from error
    if found.dtype.kind not in "fiu":
        raise Error(f"{name}: found dtype {found.dtype}, expected {expected}")
    return found.astype(np.float64)


def rows(name: str, value: Any) -> npt.NDArray[np.float64]:
    """Rows of three finite numbers."""
    found = np.ascontiguousarray(numbers(name, value, "numbers [n, 3]"))
    if found.ndim != 2 or found.shape[1] != 3:
        raise Error(f"{name}: found shape {found.shape}, expected [n, 3]")
    if not np.isfinite(found).all():
        raise Error(f"{name}: found numbers that are not finite, expected finite ones")
    return found


def color(name: str, value: Any) -> list[float]:
    """A colour: three numbers from 0 to 1, or one for all channels."""
    found = numbers(name, value, "three numbers from 0 to 1")
    inside = bool(((found >= 0) & (found <= 1)).all())
    if found.shape not in ((), (1,), (3,)) or not inside:
        raise Error(f"{name}: found {value!r}, expected three numbers from 0 to 1")
    spread: list[float] = np.broadcast_to(found, (3,)).tolist()
    return spread


def size(value: Any) -> tuple[int, int]:
    """Width and height of a picture: two numbers, or one for both."""
    expected = "1 to 32768 pixels along each side, one number or width and height"
    sides = value if isinstance(value, (Sequence, np.ndarray)) else (value, value)
    if isinstance(sides, str) or len(sides) != 2:
        raise Error(f"size: found {value!r}, expected {expected}")
    width, height = (whole("size", side, expected, 1, 1 << 15) for side in sides)
    return width, height
