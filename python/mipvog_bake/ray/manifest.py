"""The manifest: JSON lines, `{"input", "output", "options"}`, as in
`mipvog-bake bake --manifest`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from posixpath import normpath
from typing import Any

from .failure import MALFORMED, Failure
from .store import parent, read_lines

_FORM = 'expected {"input": PATH, "output": PATH, "options": {...}}; correct this line'
_NAMES = ("input", "output", "options")


@dataclass(frozen=True)
class Scene:
    """A scene to bake: the values of its line."""

    input: str
    output: str
    options: dict[str, Any] = field(default_factory=dict)


def read(manifest: str) -> Iterator[Scene]:
    """The scenes of a manifest at a path or a URI, one at a time."""
    for number, line in enumerate(read_lines(manifest), 1):
        if line.strip():
            yield _scene(line, f"{manifest}: line {number}")


def check(manifest: str) -> int:
    """Checks all lines, collects the names of the outputs, and returns the number of scenes."""
    outputs = set()
    for scene in read(manifest):
        # `./a` and `a` are one file.
        plain = normpath(scene.output)
        if plain in outputs:
            message = f"{manifest}: found the output {scene.output} twice, expected it once"
            raise Failure(message, MALFORMED)
        outputs.add(plain)
    if not outputs:
        raise Failure(f"{manifest}: found no line, expected a scene a line", MALFORMED)
    return len(outputs)


def folder(manifest: str) -> str:
    """The folder that paths of inputs are relative to."""
    return parent(manifest)


def _scene(line: str, place: str) -> Scene:
    try:
        members = json.loads(line)
    except ValueError as error:
        raise Failure(f"{place}: found no JSON ({error}), {_FORM}", MALFORMED) from None
    if not isinstance(members, dict):
        raise Failure(f"{place}: found {type(members).__name__}, {_FORM}", MALFORMED)
    for name in members:
        if name not in _NAMES:
            raise Failure(f"{place}: found key {name}, {_FORM}", MALFORMED)
    for name in ("input", "output"):
        path = members.get(name)
        if not isinstance(path, str) or path in ("", "-"):
            raise Failure(f"{place}: found {name} {path!r}, {_FORM}", MALFORMED)
    output = members["output"]
    if output.startswith("/") or ".." in output.split("/") or "://" in output:
        found = f"found output {output}"
        expected = "expected a path below --output; correct this line"
        raise Failure(f"{place}: {found}, {expected}", MALFORMED)
    options = members.get("options", {})
    if not isinstance(options, dict):
        raise Failure(f"{place}: found options {options!r}, {_FORM}", MALFORMED)
    return Scene(members["input"], output, options)
