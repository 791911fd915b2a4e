"""The command line."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from contextlib import ExitStack
from typing import Any, Optional, TextIO

from . import program
from .driver import Options, bake_all, dumps
from .failure import Failure

_INTERRUPTED = 130


def main(arguments: Optional[list[str]] = None) -> int:
    """Bakes the scenes of a manifest. Returns 0, 1 if a scene failed, or the exit code of a
    failure."""
    asked = _parser().parse_args(arguments)
    try:
        return _run(asked)
    except Failure as failure:
        print(f"error: {failure}", file=sys.stderr)
        return failure.exit_code
    except KeyboardInterrupt:
        print("error: stopped on request; run again to go on", file=sys.stderr)
        return _INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m mipvog_bake.ray",
        description="Bakes the scenes of a manifest on a Ray cluster. Scenes that are there and "
        "have not changed are passed over, so a run that was stopped goes on where it was.",
    )
    parser.add_argument("manifest", help="JSON lines: {input, output, options}; a path or a URI")
    parser.add_argument(
        "-o", "--output", required=True, help="folder or URI (s3://, gs://, ...) of the outputs"
    )
    parser.add_argument(
        "--address", help="auto, host:port or ray://host:port of a cluster; else this machine's"
    )
    parser.add_argument(
        "--report", help="write a line a scene to this file, and the table to stdout"
    )
    parser.add_argument(
        "--program", help=f"mipvog-bake on the workers; else that of ${program.VARIABLE} or PATH"
    )
    return parser


def _run(asked: argparse.Namespace) -> int:
    tool = program.find(asked.program)
    with ExitStack() as stack:
        lines: list[TextIO] = []
        if asked.report:
            path, table = asked.report, sys.stdout
        else:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="mipvog-bake-"))
            path, table = os.path.join(folder, "report.jsonl"), sys.stderr
            lines.append(sys.stdout)
        try:
            lines.append(stack.enter_context(open(path, "w", encoding="utf-8")))
        except OSError as error:
            raise Failure(f"cannot write {path}: {error.strerror}; check the path", 5) from error

        def tell(result: dict[str, Any]) -> None:
            for file in lines:
                file.write(dumps(result))
                file.flush()

        options = Options(asked.manifest, asked.output, asked.address, asked.program)
        failed = bake_all(options, tell)
        print(program.summary(tool, path), end="", file=table)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
