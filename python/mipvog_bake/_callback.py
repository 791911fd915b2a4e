"""Calls of the caller's model: passes NumPy or torch arrays, returns checked NumPy arrays."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from ._error import Error

# Colours of models may leave 0 to 1 a little; this far outside they are of another range.
_FAR_OUTSIDE = 0.5
# Float types that ml_dtypes adds to NumPy.
_ADDED = ("bfloat16", "float8_e4m3fn", "float8_e5m2")


class Callback:
    """A function from rows of three numbers to `width` numbers per row.

    It gets tensors if a `device` is given, if it is a torch module (on the device of its
    parameters), or if it does not accept arrays and torch is loaded. Otherwise it gets NumPy
    arrays.
    """

    def __init__(self, name: str, function: Callable[..., Any], width: int, device: Any) -> None:
        if not callable(function):
            found = type(function).__name__
            raise Error(f"{name}: found {found}, expected a function of positions")
        self.calls = 0
        self.rows = 0
        self._name, self._function, self._width = name, function, width
        self._is_color = name == "color"
        self._warned = False
        self._named_device = device is not None
        _warn_of_training(name, function)
        self._device = device if device is not None else _device_of(function)
        if self._device is not None and "torch" not in sys.modules:
            try:
                import torch  # noqa: F401
            except ImportError as error:
                raise Error(
                    f"device: found {device!r} without torch, expected torch to be installed",
                    help="install torch, or leave device out: the functions then get arrays",
                ) from error

    def __call__(self, *rows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        found = self._call(rows)
        self.calls += 1
        self.rows += len(rows[0])
        return self._checked(found, len(rows[0]))

    def _call(self, rows: tuple[npt.NDArray[np.float32], ...]) -> Any:
        if self._device is not None:
            return self._call_torch(rows, self._device)
        try:
            return self._function(*rows)
        except Error:
            raise
        except Exception as first:
            # A function of tensors that did not say so: traced and compiled ones, and closures over
            # parameters, fail in ways of their own.
            if "torch" not in sys.modules or self.calls > 0:
                raise
            try:
                found = self._call_torch(rows, "cpu")
            except Exception as second:
                # A device that is missing is the reason; any other failure of tensors is not.
                raise (second if isinstance(second, Error) else first) from None
            self._device = "cpu"
            return found

    def _call_torch(self, rows: tuple[npt.NDArray[np.float32], ...], device: Any) -> Any:
        import torch

        try:
            with torch.no_grad():
                found = self._function(*(torch.from_numpy(row).to(device) for row in rows))
            return tensor_values(found) if isinstance(found, torch.Tensor) else found
        except (RuntimeError, AssertionError) as error:
            words = ("device", "CUDA", "NVIDIA", "driver", "meta tensor")
            if not any(word in str(error) for word in words):
                raise
            named = "name a device that this machine has, or leave device out"
            raise Error(
                f"{self._name}: found a model that does not work with tensors on {device} "
                f"({str(error).splitlines()[0]}), expected one on that device",
                kind="device",
                help=named if self._named_device else "pass device=..., the device of the model",
            ) from error

    def _checked(self, found: Any, count: int) -> npt.NDArray[np.float32]:
        try:
            values = plain_floats(np.asarray(tensor_values(found)))
        except (TypeError, ValueError, RuntimeError) as error:
            raise self._bad(f"{type(found).__name__} ({error})", "an array or a tensor") from error
        if self._is_color and values.dtype.kind in "iu":
            help = "divide the colours by 255: they are 0 to 1"
            raise self._bad(f"whole numbers, dtype {values.dtype}", "colours 0 to 1", help)
        if values.dtype.kind not in "fiu":
            raise self._bad(f"dtype {values.dtype}", "numbers")
        shapes = [(count,), (count, 1)] if self._width == 1 else [(count, self._width)]
        if values.shape not in shapes:
            raise self._bad(f"shape {values.shape}", f"shape {shapes[0]} for {count} positions")
        with np.errstate(over="ignore"):
            values = values.reshape(shapes[0]).astype(np.float32, copy=False)
        if not np.isfinite(values).all():
            bad = int(np.count_nonzero(~np.isfinite(values)))
            raise self._bad(f"{bad} numbers that are not finite", "finite numbers")
        if self._is_color and not self._warned and values.size:
            low, high = float(values.min()), float(values.max())
            if low < -_FAR_OUTSIDE or high > 1 + _FAR_OUTSIDE:
                self._warned = True
                warnings.warn(
                    f"{self._name}: found colours from {low:.3g} to {high:.3g}, expected 0 to 1: "
                    "divide by 255 if they are bytes",
                    stacklevel=2,
                )
        return values

    def _bad(self, found: str, expected: str, help: Optional[str] = None) -> Error:
        return Error(
            f"{self._name}: found {found}, expected {expected}",
            kind="malformed",
            place=self._name,
            exit_code=3,
            help=help or f"correct what the function {self._name} returns",
        )


def tensor_values(value: Any) -> Any:
    """The values of a torch tensor in a form that NumPy can read; any other value unchanged.
    Parameters are detached, and bfloat16, which NumPy lacks, becomes float32."""
    torch = sys.modules.get("torch")
    if torch is None or not isinstance(value, torch.Tensor):
        return value
    value = value.detach().cpu()
    return (value.float() if value.dtype == torch.bfloat16 else value).numpy()


def plain_floats(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Converts number types that other packages add to NumPy, such as bfloat16, to float32."""
    return array.astype(np.float32) if array.dtype.name in _ADDED else array


def _warn_of_training(name: str, function: Any) -> None:
    """Warns of a torch module in training mode, in which its values differ."""
    torch = sys.modules.get("torch")
    owner = getattr(function, "__self__", function)
    if torch is None or not isinstance(owner, torch.nn.Module):
        return
    modules = [module for module in owner.modules() if module.training]
    names = sorted({type(one).__name__ for one in modules if _changes(torch, one)})
    if names:
        warnings.warn(
            f"{name}: found a model in training mode with {', '.join(names)}, expected one that "
            "gives the same values each time: call its eval() first",
            stacklevel=4,
        )


def _changes(torch: Any, module: Any) -> bool:
    changing = (torch.nn.modules.dropout._DropoutNd, torch.nn.modules.batchnorm._BatchNorm)
    return isinstance(module, changing)


def _device_of(function: Any) -> Any:
    """The device of a torch module, or of the module that a method belongs to."""
    torch = sys.modules.get("torch")
    owner = getattr(function, "__self__", function)
    if torch is None or not isinstance(owner, torch.nn.Module):
        return None
    parameter = next(iter(owner.parameters()), None)
    return "cpu" if parameter is None else parameter.device
