"""The program `mipvog-bake`: `python -m mipvog_bake` runs the same."""

import sys

from ._native import main as _main


def main() -> int:
    """Runs the program with the arguments of this process, and gives its exit code."""
    return _main(["mipvog-bake", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
