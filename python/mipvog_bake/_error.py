"""The only exception class of the module."""

from __future__ import annotations

import json
import re
from typing import Any, Optional

# An option of the program, which is a keyword here.
_OPTION = re.compile(r"--([a-z][a-z0-9]*(?:-[a-z0-9]+)*)")


def _keyword(found: re.Match[str]) -> str:
    return found.group(1).replace("-", "_")


class Error(Exception):
    """A failure: what was found, what was expected, and how to fix it.

    `kind` is a word in snake case, such as `malformed`, `exists` or `usage`; `gate` means that a
    quality gate failed. `file` and `place` locate the fault, if known. `exit_code` is the exit code
    of the program: 1 a failed gate, 2 wrong usage, 3 malformed input, 4 an unknown version or
    feature, 5 a failed read or write, 6 an exceeded limit, 7 an existing output. `help` is the
    remedy. `report` is the report of a bake whose gate failed.
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
    """Converts an error of the library. Option names become keyword names."""
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
    """Renames an error's parts after the caller's arrays, which the library reads as standard input
    `-` and as grid `k0`."""
    if error.file != "-":
        return error
    named = [
        None if text is None else text.replace("tensor k0", f"tensor {colors}")
        for text in (error.args[0].removeprefix("-: "), error.place)
    ]
    message, kind, help = f"arrays: {named[0]}", error.kind, error.help
    return Error(message, kind, "arrays", named[1], error.exit_code, help, error.report)


def bad_array(name: str, found: str, expected: str, help: str) -> Error:
    """The error for an array that cannot be used."""
    return Error(
        f"arrays: tensor {name}: found {found}, expected {expected}",
        kind="malformed",
        file="arrays",
        place=f"tensor {name}",
        exit_code=3,
        help=help,
    )
