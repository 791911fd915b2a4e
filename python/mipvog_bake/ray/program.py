"""Runs the program `mipvog-bake` in its own process, so that a crash does not end the worker."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

from . import resident
from .failure import INPUT_OUTPUT, Failure

VARIABLE = "MIPVOG_BAKE"
_NAME = "mipvog-bake"


def find(asked: str | None) -> str:
    """The path of the program: the given one, that of the environment variable, the one beside the
    interpreter, or the one on the search path."""
    for name in (asked, os.environ.get(VARIABLE), _beside(), _NAME):
        found = shutil.which(name) if name else None
        if found:
            return found
        if name and name in (asked, os.environ.get(VARIABLE)):
            raise Failure(f"found no program {name}; check the name", INPUT_OUTPUT)
    message = f"found no program {_NAME}; install it, or name it by --program or {VARIABLE}"
    raise Failure(message, INPUT_OUTPUT)


@cache
def version(asked: str | None) -> str:
    """The program's version, as it prints it."""
    ended = subprocess.run(
        [find(asked), "version"], capture_output=True, encoding="utf-8", check=False
    )
    return ended.stdout.strip()


def _beside() -> str:
    """The program that was installed with this module."""
    return os.path.join(os.path.dirname(sys.executable), _NAME)


def bake(
    program: str, line: dict[str, Any], scratch: Path, *more: str
) -> tuple[dict[str, Any], str]:
    """Bakes the scene of a manifest's line. Returns its result and the text on stderr."""
    manifest = scratch / "scene.jsonl"
    manifest.write_text(json.dumps(line) + "\n", encoding="utf-8")
    arguments = ["bake", "--manifest", str(manifest), "--index", "0", "--progress=never", *more]
    code, out, err = _run(program, arguments, scratch)
    lines = out.splitlines()
    if lines:
        return json.loads(lines[-1]), err
    if code < 0:
        words = f"the program was ended by {signal.Signals(-code).name}: perhaps memory ran out"
        code = 128 - code
    else:
        words = " ".join(err.replace(f"{manifest}: line 1: ", "").split())
        words = words.removeprefix("error: ") or f"the program ended with exit code {code}"
    failed = {"status": "failed", "exit_code": code, "output_bytes": None, "error": words}
    return failed, err


def _run(program: str, arguments: list[str], scratch: Path) -> tuple[int, str, str]:
    if program == _beside():
        return resident.run(arguments, scratch)
    ended = subprocess.run(
        [program, *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    return ended.returncode, ended.stdout, ended.stderr


def summary(program: str, report: str) -> str:
    """The table of a report."""
    arguments = [program, "report", report]
    ended = subprocess.run(arguments, capture_output=True, encoding="utf-8", check=False)
    return ended.stdout or ended.stderr
