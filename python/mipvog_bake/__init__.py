"""Bakes trained radiance fields into sparse, quantized assets that load from coarse to fine.

>>> import mipvog_bake
>>> report = mipvog_bake.bake("fine_last.tar", "scene.mipvog", stepsize=0.5)
>>> field = mipvog_bake.open("scene.mipvog")
>>> picture = field.render(None, 256)

`from_arrays` makes a field from your own arrays, `from_model` from any density and colour
functions. Every failure raises `Error`.
"""

from typing import TYPE_CHECKING, Any

from ._error import Error
from ._native import __version__

if TYPE_CHECKING:
    from ._arrays import from_arrays
    from ._bake import bake
    from ._field import Bounds, Field, open
    from ._model import from_model
    from ._view import View

# The program needs no NumPy, whose import takes most of its start: it comes with the first name
# that does.
_HOMES = {
    "Bounds": "_field",
    "Field": "_field",
    "View": "_view",
    "bake": "_bake",
    "from_arrays": "_arrays",
    "from_model": "_model",
    "open": "_field",
}

__all__ = [
    "Bounds",
    "Error",
    "Field",
    "View",
    "__version__",
    "bake",
    "from_arrays",
    "from_model",
    "open",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    found = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
