"""`bake`, the verb of the program as a function."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Union, cast

from . import _check, _native, _options
from ._arrays import sampled_arrays
from ._check import PathName, Readable, Writable
from ._error import Error, by_arrays
from ._field import Field
from ._progress import Progress, shown

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._bake_options import BakeOptions

# Rays add up many samples of a model's fog. Errors of its opacity over a step, of its colours and
# of their harmonics, and the opacity up to which blocks are dropped, are small enough for that.
_MODEL_ERROR, _MODEL_THRESHOLD = "1e-4:1e-3:1e-3", 1e-4
# Options that say how large errors may be.
_PRECISION = ("bits", "max_error", "max_bytes", "quality", "preset")


def bake(
    input: Union[PathName, Readable, Field, Mapping[str, Any]],
    output: Union[PathName, Writable],
    *,
    progress: Union[None, bool, Progress] = None,
    **options: Unpack[BakeOptions],
) -> dict[str, Any]:
    """Bakes `input` into the container `output` and returns the report of `mipvog-bake bake`.

    `input` is a checkpoint, a container or a glTF asset: a path, bytes, or a binary file that is
    open for reading. It can also be a `Field`, or a dictionary of sampled arrays: `density`
    `[X, Y, Z]`, `aabb` `[2, 3]`, and `color` `[X, Y, Z, 3]` or `sh` `[X, Y, Z, 3, B]`.

    `output` is a path, or a binary file that is open for writing, such as `io.BytesIO()`.

    Options are the program's long options with underscores: `bits=12`, `preset="web"`,
    `background=(0, 0, 0)`, `force=True`, `limit={"memory": 1 << 30}`. Options that are None or
    False are ignored. For a field of `from_model`, `alpha_threshold` defaults to 1e-4 and, unless
    `bits`, `quality` or `max_bytes` is given, `max_error` to "1e-4:1e-3:1e-3"; a `preset` overrides
    both defaults. Options that the field was opened with apply too.

    `progress` is called on the calling thread, with the step and the completed share of the work, 0
    to 1. An exception from it cancels the work. With True, a tqdm bar is shown if tqdm is
    installed, else lines. Ctrl-C cancels the work; a cancelled bake leaves no output.
    """
    given: dict[str, Any] = dict(options)
    if isinstance(input, Field) and input.report is not None:
        if all(given.get(name) is None for name in _PRECISION):
            given["max_error"] = _MODEL_ERROR
        if given.get("preset") is None and given.get("alpha_threshold") is None:
            given["alpha_threshold"] = _MODEL_THRESHOLD
    if isinstance(input, Field):
        given = {**input._options, **given}
    write = getattr(output, "write", None)
    if write is None:
        return _bake(input, _output(output), progress, given)
    with tempfile.TemporaryDirectory(prefix="mipvog-bake-") as folder:
        path = os.path.join(folder, "output.mipvog")
        report = _bake(input, path, progress, given)
        with open(path, "rb") as file:
            shutil.copyfileobj(file, cast(Writable, output))
    report["output"] = getattr(output, "name", type(output).__name__)
    return report


def _bake(
    input: Any, output: str, progress: Union[None, bool, Progress], options: Mapping[str, Any]
) -> dict[str, Any]:
    arguments = ["bake", "--quiet", "--progress=never", *_options.words("bake", options)]
    arguments.append(f"--output={output}")
    arrays, colors, data = None, "", None
    if isinstance(input, Field):
        input._values  # noqa: B018, a closed field is refused here
        arrays, colors, data = input._arrays, input._colors, input._data
    elif isinstance(input, Mapping):
        arrays, colors = sampled_arrays(input), "color" if input.get("sh") is None else "sh"
    else:
        data = _check.data("input", input)
    if arrays is not None or data is not None:
        source = "-"
    else:
        source = input._path or "" if isinstance(input, Field) else _source(input)
    arguments += ["--", source]
    fit = None
    if isinstance(input, Field) and input.report is not None:
        # The fit was made before the bake, which sees coefficients.
        made = input.report["view"]
        fit = (made["degree"], made["held_out_psnr"])
    with shown(progress) as callback:
        try:
            found = _native.call(arguments, arrays, callback, fit, data)
        except Error as error:
            raise by_arrays(error, colors) if arrays is not None else error from None
    report: dict[str, Any] = json.loads(found)
    if isinstance(input, Field) and input.report is not None:
        report["model"] = input.report
    return report


def _output(output: Any) -> str:
    """The path of an output; refuses standard streams."""
    path = _check.path("output", output)
    if path == "-":
        raise Error("output: found the standard output, expected a path or a binary file")
    return path


def _source(input: Any) -> str:
    if not isinstance(input, (str, bytes, os.PathLike)):
        found = type(input).__name__
        raise Error(f"input: found {found}, expected a path, a Field or arrays by name")
    return _options.source("input", input)
