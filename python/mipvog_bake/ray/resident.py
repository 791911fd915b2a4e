"""Runs the program of this module in a process that stays ready beside the worker: starting an
interpreter per scene would take longer than baking a small one.

`python -m mipvog_bake.ray.resident` reads one JSON object per line: the arguments of the program
and two files for its output. It answers each line with the exit code.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Optional

_process: Optional[subprocess.Popen[str]] = None


def run(arguments: list[str], scratch: Path) -> tuple[int, str, str]:
    """The program's exit code, negative for a signal that ended it, and its output on stdout and
    stderr."""
    global _process
    out, err = scratch / "stdout", scratch / "stderr"
    if _process is None or _process.poll() is not None:
        words = [sys.executable, "-m", __name__]
        _process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, encoding="utf-8"
        )
    assert _process.stdin and _process.stdout
    request = {"arguments": arguments, "out": str(out), "err": str(err)}
    try:
        _process.stdin.write(json.dumps(request) + "\n")
        _process.stdin.flush()
        answer = _process.stdout.readline()
    except BrokenPipeError:
        answer = ""
    code = int(answer) if answer else _process.wait()
    if not answer:
        _process.stdin.close()
        _process.stdout.close()
        _process = None
    return code, _text(out), _text(err)


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""


def _serve() -> None:
    from mipvog_bake import _native

    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    for line in sys.stdin:
        request = json.loads(line)
        for stream, path in ((1, request["out"]), (2, request["err"])):
            file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            os.dup2(file, stream)
            os.close(file)
        code = _native.main(["mipvog-bake", *request["arguments"]])
        answers.write(f"{code}\n")
        answers.flush()


if __name__ == "__main__":
    _serve()
