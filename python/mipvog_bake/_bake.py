"""`bake`: the program's verb as a function."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Optional, Union

from . import _check, _native, _options
from ._arrays import open_door
from ._check import PathName
from ._error import Error, by_arrays
from ._field import Field, Progress

# Rays add up many samples of a model's fog. Errors of its opacity over a step, of its colours and
# of their harmonics, and the opacity up to which blocks are dropped, are small enough for that.
_MODEL_ERROR, _MODEL_THRESHOLD = "1e-4:1e-3:1e-3", 1e-4
# Options that say how large errors may be.
_PRECISION = ("bits", "max_error", "max_bytes", "quality", "preset")


def bake(
    input: Union[PathName, Field, Mapping[str, Any]],
    output: PathName,
    *,
    progress: Union[None, bool, Progress] = None,
    **options: Any,
) -> dict[str, Any]:
    """Bakes `input` into the container `output`, and gives the report of `mipvog-bake bake`.

    `input` is the path of a checkpoint, a container or a glTF asset, a `Field`, or a dictionary of
    arrays as the open door has them: `density` `[X, Y, Z]`, `aabb` `[2, 3]`, and `color` `[X, Y, Z,
    3]` or `sh` `[X, Y, Z, 3, B]`.

    Options are the program's long ones with underscores: `bits=12`, `preset="web"`,
    `background=(0, 0, 0)`, `force=True`, `limit={"memory": 1 << 30}`. An option that is None or
    False is not given. A field of `from_model` has `alpha_threshold=1e-4`, and
    `max_error="1e-4:1e-3:1e-3"` unless `bits`, `quality` or `max_bytes` is given; a `preset` sets
    both. The options that a field was opened with count too.

    `progress` is called with the step and the share of the work that is done, 0 to 1, on the thread
    that called; what it raises ends the work. True shows a bar of tqdm where that is installed,
    else lines. Ctrl-C ends the work, and leaves no output.
    """
    if isinstance(input, Field) and input.report is not None:
        if all(options.get(name) is None for name in _PRECISION):
            options["max_error"] = _MODEL_ERROR
        if options.get("preset") is None:
            options.setdefault("alpha_threshold", _MODEL_THRESHOLD)
    if isinstance(input, Field):
        options = {**input._options, **options}
    arguments = ["bake", "--quiet", "--progress=never", *_options.words("bake", options)]
    arguments.append(f"--output={_check.path('output', output)}")
    arrays, colors = None, ""
    if isinstance(input, Field) and input._arrays is not None:
        arrays, colors = input._arrays, input._colors
    elif isinstance(input, Mapping):
        arrays, colors = open_door(input), "color" if input.get("sh") is None else "sh"
    if arrays is not None:
        source = "-"
    else:
        source = input._path or "" if isinstance(input, Field) else _source(input)
    arguments += ["--", source]
    fit = None
    if isinstance(input, Field) and input.report is not None:
        # The fit was made before the bake, which sees coefficients.
        made = input.report["view"]
        fit = (made["degree"], made["held_out_psnr"])
    with _shown(progress) as callback:
        try:
            report: dict[str, Any] = json.loads(_native.call(arguments, arrays, callback, fit))
        except Error as error:
            raise by_arrays(error, colors) if arrays is not None else error from None
    if isinstance(input, Field) and input.report is not None:
        report["model"] = input.report
    return report


def _source(input: Any) -> str:
    if not isinstance(input, (str, bytes, os.PathLike)):
        found = type(input).__name__
        raise Error(f"input: found {found}, expected a path, a Field or arrays by name")
    return _options.source("input", input)


@contextmanager
def _shown(progress: Union[None, bool, Progress]) -> Iterator[Optional[Progress]]:
    """A callback for what the user wants to see."""
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
    """Lines on the standard error, one a step."""
    last = None

    def show(step: str, share: float) -> None:
        nonlocal last
        if step != last:
            print(f"{step}, {100 * share:.0f} %", file=sys.stderr)
        last = step

    return show
