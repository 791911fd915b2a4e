"""Progress for the caller: the caller's function, a bar, or nothing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Optional, Union

from . import _check

# Called with the step, and the share of the work that is done.
Progress = Callable[[str, float], Any]


@contextmanager
def shown(progress: Union[None, bool, Progress]) -> Iterator[Optional[Progress]]:
    """A callback that shows progress as the caller requested."""
    if progress is None or progress is False:
        yield None
        return
    if progress is not True:
        yield _check.function("progress", progress)
        return
    try:
        from tqdm.auto import tqdm
    except ImportError:
        yield _lines()
        return
    with tqdm(total=100, unit="%", bar_format="{l_bar}{bar}| {elapsed}<{remaining}") as bar:

        def show(step: str, share: float) -> None:
            bar.set_description(step, refresh=False)
            bar.update(100 * share - bar.n)

        yield show


def _lines() -> Callable[[str, float], None]:
    """Prints a line per step to stderr."""
    last = None

    def show(step: str, share: float) -> None:
        nonlocal last
        if step != last:
            print(f"{step}, {100 * share:.0f} %", file=sys.stderr)
        last = step

    return show
