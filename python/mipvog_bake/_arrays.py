"""Python arrays as fields, borrowed if their memory has the right order and type."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _check, _native
from ._callback import plain_floats, tensor_values
from ._error import Error, bad_array
from ._field import Field

# Element types by the names of safetensors.
_FLOATS = {np.dtype(np.float32): "F32", np.dtype(np.float16): "F16"}
_WHOLE = {np.dtype(np.int32): "I32", np.dtype(np.int64): "I64"}
# Settings of sampled arrays.
_SETTINGS = ("offset", "clamp", "stepsize", "background", "block_size", "dimensions")
_NUMBERS = {"background": 3, "dimensions": 3}
_CLAMPS = ("zero", "none", "sigmoid")
_ARRAYS = ("density", "aabb", "sh", "color", "blocks")

# A layer by the checkpoint's name.
_LAYER = re.compile(r"(?:.*rgbnet\.)?([0-9]+\.(?:weight|bias))")

Network = Union[Mapping[str, Any], Sequence[tuple[Any, Any]]]
# Name, element type, shape, and bytes in pieces.
Tensor = tuple[str, str, list[int], list[npt.NDArray[np.uint8]]]


def as_array(name: str, value: Any) -> npt.NDArray[Any]:
    """Converts a value to an array in memory: from NumPy, or from any library that exports
    arrays."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise bad_array(
            name,
            f"a masked array with {int(np.ma.getmaskarray(value).sum())} masked values",
            "an array without a mask",
            f"fill it: {name}.filled(value)",
        )
    try:
        array = plain_floats(np.asarray(tensor_values(value)))
    except (TypeError, RuntimeError, ValueError) as error:
        raise bad_array(
            name,
            f"{type(value).__name__} that NumPy cannot read ({error})",
            "an array in the memory of the processor",
            "of a torch tensor pass tensor.detach().cpu().numpy()",
        ) from error
    if any(stride < 0 for stride in array.strides):
        raise bad_array(
            name,
            f"strides {array.strides}",
            "none below 0",
            f"pass numpy.ascontiguousarray({name})",
        )
    return array


def _floats(name: str, value: Any) -> npt.NDArray[Any]:
    """An array of floats in memory."""
    array = as_array(name, value)
    if array.dtype.kind != "f":
        raise bad_array(
            name,
            f"dtype {array.dtype}",
            "float32, float16 or float64",
            f"pass {name}.astype(numpy.float32) if the numbers mean what they should",
        )
    return array


def as_tensor(name: str, arrays: Sequence[Any], shape: Sequence[int]) -> Tensor:
    """Concatenates float arrays to one tensor of a shape. Float32 and float16 arrays in C order are
    borrowed; all others are converted to float32."""
    found = [_floats(name, array) for array in arrays]
    half = all(array.dtype == np.float16 for array in found)
    target = np.dtype(np.float16 if half else np.float32)
    parts = []
    for array in found:
        part = np.ascontiguousarray(array, dtype=target)
        parts.append(part.reshape(-1).view(np.uint8))
    return name, _FLOATS[target], list(shape), parts


def _whole(name: str, value: Any) -> Tensor:
    array = as_array(name, value)
    if array.dtype.kind not in "iu":
        expected, help = "int32 or int64", f"pass {name}.astype(numpy.int32)"
        raise bad_array(name, f"dtype {array.dtype}", expected, help)
    array = np.ascontiguousarray(array, dtype=array.dtype if array.dtype in _WHOLE else np.int64)
    return name, _WHOLE[array.dtype], list(array.shape), [array.reshape(-1).view(np.uint8)]


def corners(name: str, value: Any) -> npt.NDArray[np.float64]:
    """The two corners of a box, `[2, 3]`."""
    array = as_array(name, value)
    help = "pass ((x, y, z), (x, y, z)), the lowest corner first"
    if array.dtype.kind not in "fiu" or array.size != 6:
        found = f"dtype {array.dtype} of shape {array.shape}"
        raise bad_array(name, found, "two corners of three numbers", help)
    low, high = array.astype(np.float64).reshape(2, 3)
    if not (np.isfinite(low) & np.isfinite(high) & (low < high)).all():
        found = f"{low.tolist()} and {high.tolist()}"
        raise bad_array(name, found, "finite corners with some extent along each axis", help)
    return np.stack([low, high])


def _text(name: str, value: Any) -> str:
    """A setting as text, as the file stores it."""
    # Texts of an .npz are arrays.
    if isinstance(value, np.ndarray) and value.dtype.kind == "U":
        value = str(value)
    if name == "clamp":
        if value not in _CLAMPS:
            raise Error(f"clamp: found {value!r}, expected {', '.join(_CLAMPS)}")
        return str(value)
    count = _NUMBERS.get(name, 1)
    expected = "a number" if count == 1 else f"{count} numbers"
    found = _check.numbers(name, value, expected).reshape(-1)
    if len(found) != count or not np.isfinite(found).all():
        raise Error(f"{name}: found {value!r}, expected {expected}")
    return ",".join(map(repr, found.tolist()))


def sampled_arrays(arrays: Mapping[str, Any]) -> _native.Arrays:
    """Checks sampled arrays by name and passes them to the library."""
    known = _ARRAYS + _SETTINGS
    unknown = [name for name in arrays if name not in known]
    if unknown:
        raise Error(
            f"arrays: found {', '.join(map(repr, unknown))}, expected names of sampled arrays",
            kind="malformed",
            file="arrays",
            exit_code=3,
            help=f"it knows {', '.join(known)}",
        )
    tensors: list[Tensor] = []
    texts: dict[str, str] = {}
    for name, value in arrays.items():
        if value is None:
            continue
        if name in _SETTINGS:
            texts[name] = _text(name, value)
        elif name == "blocks":
            tensors.append(_whole(name, value))
        elif name == "aabb":
            tensors.append(as_tensor(name, [corners(name, value)], (2, 3)))
        else:
            array = as_array(name, value)
            tensors.append(as_tensor(name, [array], array.shape))
    missing = [name for name in ("density", "aabb") if arrays.get(name) is None]
    if arrays.get("sh") is None and arrays.get("color") is None:
        missing.append("sh or color")
    if missing:
        raise Error(
            f"arrays: found no {' and no '.join(missing)}",
            kind="malformed",
            file="arrays",
            exit_code=3,
            help="give density [X, Y, Z], aabb [2, 3], and color [..., 3] or sh [..., 3, B]",
        )
    return _native.Arrays(tensors, texts)


def _layers(network: Network) -> list[Tensor]:
    """Weights and biases under the checkpoint's names."""
    expected = "pairs of weight and bias, or names such as 0.weight and 0.bias"
    named = {}
    if isinstance(network, Mapping):
        for name, value in network.items():
            if not (found := _LAYER.fullmatch(str(name))):
                raise Error(f"network: found {name!r}, expected {expected}")
            named[found.group(1)] = value
    else:
        try:
            pairs = [(weight, bias) for weight, bias in network]
        except (TypeError, ValueError) as error:
            raise Error(f"network: found no pairs ({error}), expected {expected}") from error
        for number, (weight, bias) in enumerate(pairs):
            named[f"{2 * number}.weight"], named[f"{2 * number}.bias"] = weight, bias
    layers = []
    for name, value in named.items():
        array = as_array(f"network {name}", value)
        layers.append(as_tensor(f"rgbnet.{name}", [array], array.shape))
    return layers


def from_arrays(
    density: Any,
    *,
    diffuse: Any,
    features: Any = None,
    network: Optional[Network] = None,
    bounds: Any,
    shift: float = 0.0,
    interval: Optional[float] = None,
    stepsize: float = 0.5,
    near: float = 0.0,
    far: Optional[float] = None,
    background: Sequence[float] = (1.0, 1.0, 1.0),
    color_threshold: Optional[float] = None,
    frequencies: int = 4,
) -> Field:
    """Makes a trained field from arrays: raw values at nodes, as DirectVoxGO and Mip-VoG train
    them.

    `density` is `[X, Y, Z]`, raw; the opacity over one step is
    `1 - exp(-softplus(raw + shift) * interval)`. `diffuse` is `[3, X, Y, Z]`, logits of colour.
    `features` is `[4, X, Y, Z]` and requires a `network`: pairs of weight `[out, in]` and bias
    `[out]`, layer by layer, or a dictionary with the checkpoint's names. The network runs once per
    ray, on the features and `frequencies` octaves of the direction. `bounds` are two corners in
    world units; nodes 0 and N - 1 lie on the faces of the box. `stepsize` is the distance between
    samples in voxels. `interval` defaults to `stepsize`.

    Float32 arrays in C order are borrowed, not copied: do not change them before the bake.
    """
    grid, colors = _floats("density", density), [_floats("diffuse", diffuse)]
    if features is not None:
        colors.append(_floats("features", features))
    if grid.ndim != 3:
        help = "drop axes of one element with density.reshape(X, Y, Z)"
        raise bad_array("density", f"shape {grid.shape}", "[X, Y, Z]", help)
    for name, array in zip(("diffuse", "features"), colors, strict=False):
        own = "3" if name == "diffuse" else "F"
        fits = array.ndim == 4 and array.shape[1:] == grid.shape
        if not fits or (name == "diffuse" and array.shape[0] != 3):
            expected = f"[{own}, {', '.join(map(str, grid.shape))}]"
            help = "channels come first, and the nodes are those of density"
            raise bad_array(name, f"shape {array.shape}", expected, help)
    low, high = corners("bounds", bounds)
    offset = _check.number("shift", shift, "a finite number")
    step = _check.number("stepsize", stepsize, "a number of voxels above 0", 0)
    ratio = 1.0
    if interval is not None:
        ratio = _check.number("interval", interval, "a number of voxels above 0", 0) / step
    start = _check.number("near", near, "a distance")
    behind = _check.color("background", background)
    octaves = _check.whole("frequencies", frequencies, "a number of octaves, 0 to 32", 0, 32)
    channels = sum(array.shape[0] for array in colors)
    tensors = [
        as_tensor("density", [grid], (1, 1, *grid.shape)),
        as_tensor("k0", colors, (1, channels, *grid.shape)),
        as_tensor("xyz_min", [low], (3,)),
        as_tensor("xyz_max", [high], (3,)),
        ("act_shift", "F64", [1], [np.array([offset]).view(np.uint8)]),
    ]
    tensors += _layers(network) if network is not None else []
    texts = {
        "stepsize": repr(step),
        "near": repr(start),
        "background": repr(behind),
        "num_voxels": str(grid.size),
        "voxel_size_ratio": repr(ratio),
        "viewbase_pe": str(octaves),
    }
    if far is not None:
        texts["far"] = repr(_check.number("far", far, "a distance beyond near", start))
    if color_threshold is not None:
        least = _check.number("color_threshold", color_threshold, "a finite number")
        texts["fast_color_thres"] = repr(least)
    names = "diffuse" if features is None else "diffuse or features"
    return Field.of_arrays(_native.Arrays(tensors, texts), colors=names)
