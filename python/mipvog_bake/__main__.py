"""The program `mipvog-bake`, as `python -m mipvog_bake`."""

import signal
import sys

from ._native import main as _main


def main() -> int:
    """Runs the program with this process's arguments and returns its exit code."""
    # The program watches signals itself. Python's own handler would end it with a traceback.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _main(["mipvog-bake", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
