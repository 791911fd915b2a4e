"""Open fields: their contents, samples and pictures."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from typing import Any, NamedTuple, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _check, _native, _options
from ._check import PathName, Readable
from ._error import Error
from ._progress import Progress, shown
from ._view import View, page_of

Floats = npt.NDArray[np.float32]

_ELEMENTS = {"F32": np.float32, "F64": np.float64, "U8": np.uint8}
# Angle of view along x of a camera that is a bare matrix, in radians.
_ANGLE = 0.6911112
# Pixels along a side of the picture that notebooks show.
_SHOWN = 320


class Bounds(NamedTuple):
    """A box in world units."""

    min: tuple[float, float, float]
    max: tuple[float, float, float]


class Field:
    """An open field: a container, or a trained input that is not baked yet.

    `open`, `from_arrays` and `from_model` return fields. Values are read on demand. Fields can be
    pickled and copied: as their path or bytes with the options of `open`, or as their arrays.
    `close`, or the end of a `with` block, frees the memory. The file of an open field can be
    replaced; the field keeps showing the file that it opened.
    """

    def __init__(
        self,
        native: _native.NativeField,
        path: Optional[str] = None,
        arrays: Optional[_native.Arrays] = None,
        report: Optional[dict[str, Any]] = None,
        colors: str = "sh",
        options: Optional[dict[str, Any]] = None,
        data: Optional[bytes] = None,
    ) -> None:
        self._open: Optional[_native.NativeField] = native
        # What it was opened with.
        self._options = options or {}
        self._path = path
        self._arrays = arrays
        self._data = data
        self._description: dict[str, Any] = json.loads(native.description())
        self._report = report
        # The caller's name for the arrays of colours.
        self._colors = colors
        # The picture that notebooks show, once one did.
        self._png: Optional[bytes] = None

    @property
    def _values(self) -> _native.NativeField:
        if self._open is None:
            raise Error("found a field that is closed, expected an open one", help="open it again")
        return self._open

    def close(self) -> None:
        """Frees the memory and closes the file. Properties remain available; values can no longer
        be read."""
        self._open, self._arrays, self._data = None, None, None

    def __enter__(self) -> Field:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        if self._open is None:
            raise Error("found a field that is closed, expected an open one", help="open it again")
        if self._arrays is not None:
            return _of_arrays, (self._arrays, self._report, self._colors)
        return _of_source, (self._path if self._data is None else self._data, self._options)

    @classmethod
    def of_arrays(
        cls, arrays: _native.Arrays, report: Optional[dict[str, Any]] = None, colors: str = "sh"
    ) -> Field:
        """A field whose file consists of arrays."""
        native = _native.NativeField.of_arrays(arrays)
        return cls(native, arrays=arrays, report=report, colors=colors)

    @property
    def dimensions(self) -> tuple[int, int, int]:
        """Nodes of the finest level along x, y and z."""
        x, y, z = self._description["dimensions"]
        return x, y, z

    @property
    def bounds(self) -> Bounds:
        """The box, in world units. Nodes 0 and N - 1 lie on its faces."""
        found = self._description["bounds"]
        return Bounds(tuple(found["min"]), tuple(found["max"]))

    @property
    def levels(self) -> list[dict[str, Any]]:
        """The levels, fine to coarse, as in the report of `inspect`."""
        levels: list[dict[str, Any]] = deepcopy(self._description["levels"])
        return levels

    @property
    def metadata(self) -> dict[str, Any]:
        """The container's metadata. For a field that is not baked, the settings of its rays."""
        metadata: dict[str, Any] = deepcopy(self._description["metadata"])
        return metadata

    @property
    def model(self) -> str:
        """`baked`, or the family of a trained input as in the report of `inspect`."""
        model: str = self._description["model"]
        return model

    @property
    def report(self) -> Optional[dict[str, Any]]:
        """For a field of `from_model`: numbers of samples, bytes and the error of its fit."""
        return self._report

    def unpack(self, levels: Union[None, int, Sequence[int]] = None) -> dict[str, Any]:
        """The stored values of a container's levels as arrays, before any activation.

        Names and shapes are those of `mipvog-bake unpack`: `level0.density` is `[X, Y, Z]`,
        `level0.diffuse` `[3, X, Y, Z]`, and so on.
        """
        chosen: list[int] = []
        if levels is not None:
            several = levels if isinstance(levels, Iterable) else [levels]
            chosen = [_check.whole("levels", one, "level numbers from 0") for one in several]
            if not chosen:
                raise Error("levels: found no number, expected some, or None for all")
        return {
            name: bytes_.view(_ELEMENTS[dtype]).reshape(shape)
            for name, dtype, shape, bytes_ in self._values.unpack(chosen)
        }

    def probe(
        self, origins: Any, directions: Any, level: Optional[int] = None
    ) -> tuple[Floats, Floats, Floats]:
        """The light along rays: `rgb` `[n, 3]` over the background and not clamped, `transmittance`
        `[n]` and `depth` `[n]`. Directions need not have unit length. All samples come from one
        level, by default the finest."""
        starts, ways = _check.rows("origins", origins), _check.rows("directions", directions)
        if len(starts) != len(ways):
            raise Error(
                f"found {len(starts)} origins and {len(ways)} directions, expected as many of each"
            )
        lengths = np.linalg.norm(ways, axis=1, keepdims=True)
        if not (lengths > 0).all():
            raise Error("directions: found one of length 0, expected directions")
        rgb, left, depth = self._values.probe(starts, ways / lengths, _level(level))
        return rgb.reshape(-1, 3), left, depth

    def sample(self, positions: Any, level: int = 0) -> dict[str, Floats]:
        """Values at points of the world: `density` `[n]`, optical depth per world unit; `opacity`
        `[n]` over one interval; and `color` `[n, 3]`, the part that does not depend on the
        direction. If the field has them, also `features` `[n, F]` and `coefficients` `[n, B, 3]` of
        harmonics."""
        points = _check.rows("positions", positions)
        found = self._values.sample(points, _level(level))
        density, opacity, color, features, coefficients = found
        values = {"density": density, "opacity": opacity, "color": color.reshape(-1, 3)}
        if features.size:
            values["features"] = features.reshape(len(points), -1)
        if coefficients.size:
            values["coefficients"] = coefficients.reshape(len(points), -1, 3)
        return values

    def render(
        self,
        camera: Any,
        size: Union[int, tuple[int, int]],
        *,
        frame: Union[None, int, str] = None,
        progress: Union[None, bool, Progress] = None,
    ) -> Floats:
        """Renders a picture `[height, width, 3]` over the background, not clamped.

        `camera` is one of: the path of a camera file, from which `frame` picks a frame by name or
        number; a dictionary in the form of such a file or of one of its frames (`transform_matrix`,
        and `camera_angle_x` or `fl_x`); a camera-to-world matrix, with a horizontal angle of view
        of 0.691 radians; or None for a view of everything visible. `size` is width and height in
        pixels, or one number for both. `progress` is as in `bake`.
        """
        width, height = _check.size(size)
        text, path = None, None
        if isinstance(camera, (str, os.PathLike)):
            path = os.fspath(camera)
        elif camera is not None:
            text = json.dumps(_camera(camera), default=_plain)
        name = None if frame is None else str(frame)
        with shown(progress) as tell:
            pixels = self._values.render(text, path, name, (width, height), tell)
        return pixels.reshape(height, width, 3)

    def show(self, height: int = 480, *, progress: Union[None, bool, Progress] = None) -> View:
        """The viewer in a frame of `height` pixels, for notebooks. The frame needs no server and is
        part of the notebook: saved notebooks and the output of nbconvert contain it. A field that
        is not baked is first baked with the default options. `progress` is as in `bake`."""
        pixels = _check.whole("height", height, "a height in pixels")
        self._values  # noqa: B018, a closed field is refused here
        return View(page_of(self, progress), pixels)

    def __repr__(self) -> str:
        x, y, z = self.dimensions
        place = f" of {self._path}" if self._path else ""
        count = len(self._description["levels"])
        levels = f", {count} level{'s' * (count != 1)}" if self.model == "baked" else ""
        return f"<mipvog_bake.Field{place}: {self.model}, {x} x {y} x {z} nodes{levels}>"

    def _repr_png_(self) -> bytes:
        if self._png is None:
            pixels = self.render(None, _SHOWN)
            values = (np.clip(pixels, 0, 1) * 255 + 0.5).astype(np.uint8)
            self._png = _native.png(_SHOWN, _SHOWN, values.tobytes())
        return self._png


def open(path: Union[PathName, Readable], **options: Any) -> Field:
    """Opens a container, a glTF asset with one, or anything that can be baked: a path, bytes, or a
    binary file that is open for reading, which is read to its end.

    Options are the scene options of the program, with underscores: `stepsize=0.5`, `near=2`,
    `mlp="none"`, `drop_background=True`, `field=1` for another field of an asset. As in the
    program, settings files beside a trained input apply, such as `scene.toml`; bytes have no such
    files. Missing settings are assumed, with a warning.
    """
    field = _of_source(path, options)
    for assumption in field._description["assumptions"]:
        warnings.warn(assumption, stacklevel=2)
    return field


def _of_source(source: Any, options: dict[str, Any]) -> Field:
    words = list(_options.words("open", options))
    data = _check.data("path", source)
    if data is not None:
        return Field(_native.NativeField.of_bytes(words, data), data=data, options=options)
    name = _options.source("path", source)
    native = _native.NativeField.open([*words, "--", name])
    return Field(native, path=name if "://" in name else os.path.abspath(name), options=options)


def _of_arrays(arrays: _native.Arrays, report: Optional[dict[str, Any]], colors: str) -> Field:
    return Field.of_arrays(arrays, report, colors)


def _level(level: Optional[int]) -> int:
    return 0 if level is None else _check.whole("level", level, "a whole number from 0")


def _camera(camera: Any) -> dict[str, Any]:
    """A camera in the form of a camera file."""
    if isinstance(camera, Mapping):
        found = dict(camera)
        if "frames" in found:
            return found
        if "transform_matrix" not in found:
            raise Error(
                f"camera: found a dictionary of {', '.join(map(repr, found))}, expected "
                "transform_matrix, and camera_angle_x or fl_x"
            )
        found["transform_matrix"] = _matrix(found["transform_matrix"])
        return {"frames": [found]}
    return {"camera_angle_x": _ANGLE, "frames": [{"transform_matrix": _matrix(camera)}]}


def _matrix(value: Any) -> list[list[float]]:
    matrix = _check.numbers("camera", value, "a matrix from camera to world")
    if matrix.shape not in ((3, 4), (4, 4)):
        raise Error(f"camera: found a matrix of shape {matrix.shape}, expected 3 x 4 or 4 x 4")
    if not np.isfinite(matrix).all():
        raise Error("camera: found numbers that are not finite, expected finite ones")
    rows: list[list[float]] = matrix[:3].tolist()
    return [*rows, [0.0, 0.0, 0.0, 1.0]]


def _plain(value: Any) -> Any:
    """Converts values that JSON cannot represent, such as NumPy numbers."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    found = type(value).__name__
    raise Error(f"camera: found {found}, expected numbers, texts, lists and dictionaries")
