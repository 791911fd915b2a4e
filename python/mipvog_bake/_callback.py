"""Calls of somebody's model: NumPy or torch in, checked NumPy out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ._error import Error


class Callback:
    """A function of rows of three numbers that gives `width` numbers a row.

    It gets tensors if a `device` is named, if it is a torch module (on the device of its
    parameters), or if it does not take arrays and torch is loaded.
    """

    def __init__(self, name: str, function: Callable[..., Any], width: int, device: Any) -> None:
        if not callable(function):
            found = type(function).__name__
            raise Error(f"{name}: found {found}, expected a function of positions")
        self.calls = 0
        self.rows = 0
        self._name, self._function, self._width = name, function, width
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
        except (TypeError, AttributeError):
            # A function of tensors that did not say so.
            if "torch" not in sys.modules or self.calls > 0:
                raise
            found = self._call_torch(rows, "cpu")
            self._device = "cpu"
            return found

    def _call_torch(self, rows: tuple[npt.NDArray[np.float32], ...], device: Any) -> Any:
        import torch

        try:
            with torch.no_grad():
                found = self._function(*(torch.from_numpy(row).to(device) for row in rows))
            return found.detach().cpu().numpy() if isinstance(found, torch.Tensor) else found
        except (RuntimeError, AssertionError) as error:
            if not any(word in str(error) for word in ("device", "CUDA", "meta tensor")):
                raise
            raise Error(
                f"{self._name}: found a model that does not work with tensors on {device} "
                f"({str(error).splitlines()[0]}), expected one on that device",
                kind="device",
                help="pass device=..., the device that the model is on",
            ) from error

    def _checked(self, found: Any, count: int) -> npt.NDArray[np.float32]:
        if "torch" in sys.modules and isinstance(found, sys.modules["torch"].Tensor):
            found = found.detach().cpu().numpy()
        try:
            values = np.asarray(found)
        except (TypeError, ValueError, RuntimeError) as error:
            raise self._bad(f"{type(found).__name__} ({error})", "an array or a tensor") from error
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
        return values

    def _bad(self, found: str, expected: str) -> Error:
        return Error(
            f"{self._name}: found {found}, expected {expected}",
            kind="malformed",
            place=self._name,
            exit_code=3,
            help=f"correct what the function {self._name} returns",
        )


def _device_of(function: Any) -> Any:
    """The device of a torch module, or of a method of one."""
    torch = sys.modules.get("torch")
    owner = getattr(function, "__self__", function)
    if torch is None or not isinstance(owner, torch.nn.Module):
        return None
    parameter = next(iter(owner.parameters()), None)
    return "cpu" if parameter is None else parameter.device
