"""The one exception of the module."""

from __future__ import annotations

import json
import re
from typing import Any, Optional

# An option of the program, which is a keyword here.
_OPTION = re.compile(r"--([a-z][a-z0-9]*(?:-[a-z0-9]+)*)")


def _keyword(found: re.Match[str]) -> str:
    return found.group(1).replace("-", "_")


class Error(Exception):
    """A failure: what was found, what was expected, and what to do.

    `kind` is a word in snake case, such as `malformed`, `exists` or `usage`; `gate` stands for a
    quality gate that is missed. `file` and `place` say where, if that is known. `exit_code` is what
    the program would end with: 2 wrong usage, 3 malformed input, 4 unknown version or feature, 5
    input or output failed, 6 over a limit, 7 the output exists, 1 a gate missed. `help` is the
    remedy, and `report` the report of a bake that missed its gate.
    """

    kind: str
    file: Optional[str]
    place: Optional[str]
    exit_code: int
    help: Optional[str]
    report: Optional[dict[str, Any]]

    def __init__(
        self,
        message: str,
        kind: str = "usage",
        file: Optional[str] = None,
        place: Optional[str] = None,
        exit_code: int = 2,
        help: Optional[str] = None,
        report: Optional[dict[str, Any]] = None,
    ) -> None:
        # All of it are arguments, so that pickling keeps it.
        super().__init__(message, kind, file, place, exit_code, help, report)
        self.kind = kind
        self.file = file
        self.place = place
        self.exit_code = exit_code
        self.help = help
        self.report = report

    def __str__(self) -> str:
        message: str = self.args[0]
        return f"{message}\nhelp: {self.help}" if self.help else message


def from_native(message: str, *, help: str, report: Optional[str], **details: Any) -> Error:
    """An error of the library, in which options have the names that keywords have."""
    if help.startswith("see --help"):
        help = "see help(mipvog_bake.bake)"
    if details["file"] == "arrays" and details["kind"] == "malformed":
        help = "correct the array: see help(mipvog_bake.bake)"
    return Error(
        _OPTION.sub(_keyword, message),
        help=_OPTION.sub(_keyword, help),
        report=None if report is None else json.loads(report),
        **details,
    )


def by_arrays(error: Error, colors: str) -> Error:
    """An error of a bake by the names of the caller's arrays, which the library reads as the
    standard input `-` and as the grid `k0`."""
    if error.file != "-":
        return error
    named = [
        None if text is None else text.replace("tensor k0", f"tensor {colors}")
        for text in (error.args[0].removeprefix("-: "), error.place)
    ]
    message, kind, help = f"arrays: {named[0]}", error.kind, error.help
    return Error(message, kind, "arrays", named[1], error.exit_code, help, error.report)


def bad_array(name: str, found: str, expected: str, help: str) -> Error:
    """An array that cannot be taken."""
    return Error(
        f"arrays: tensor {name}: found {found}, expected {expected}",
        kind="malformed",
        file="arrays",
        place=f"tensor {name}",
        exit_code=3,
        help=help,
    )
