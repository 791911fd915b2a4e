"""Converts keyword options to arguments of the program."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from . import _check, _native
from ._error import Error

# Options of the program that a function has no use for.
_NONE_OF = ("help", "version", "output", "format", "quiet", "verbose", "color")


# What stands between the numbers of an option that are not a list to the program.
_BETWEEN = {"size": "x", "max_error": ":"}


def source(name: str, value: Any) -> str:
    """The path of an input; refuses standard streams."""
    path = _check.path(name, value)
    if path == "-":
        raise Error(f"{name}: found the standard input, expected a path")
    return path


def words(verb: str, options: Mapping[str, Any]) -> Iterator[str]:
    """The arguments for the options of a verb or of `open`. Options that are None or False are
    ignored."""
    again = dict(_native.option_names(verb))
    for name, value in options.items():
        option = name.replace("_", "-")
        if option in _NONE_OF:
            raise Error(f"found option {name}, expected one that a function has a use for")
        # The parser refuses a name that it does not know, whatever its value.
        if option in again and (value is None or value is False):
            continue
        if isinstance(value, np.ndarray) and value.ndim == 0:
            value = value.item()
        if isinstance(value, np.bool_):
            value = bool(value)
        if option in again and value is False:
            continue
        if value is True:
            yield f"--{option}"
        elif again.get(option):
            for one in _several(value):
                yield f"--{option}={one}"
        elif isinstance(value, (list, tuple, np.ndarray)):
            yield f"--{option}={_BETWEEN.get(name, ',').join(_word(one) for one in value)}"
        else:
            yield f"--{option}={_word(value)}"


def _several(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        yield from (f"{key}={_word(one)}" for key, one in value.items())
    elif isinstance(value, (list, tuple)):
        yield from map(_word, value)
    else:
        yield _word(value)


def _word(value: Any) -> str:
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.item()
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)
