"""Bakes trained radiance fields into sparse, quantized assets that load from coarse to fine.

>>> import mipvog_bake
>>> report = mipvog_bake.bake("fine_last.tar", "scene.mipvog", stepsize=0.5)
>>> field = mipvog_bake.open("scene.mipvog")
>>> picture = field.render(None, 256)

Arrays of one's own become a field by `from_arrays`, anybody's density and colour functions by
`from_model`. Every failure is an `Error`.
"""

from ._arrays import from_arrays
from ._bake import bake
from ._error import Error
from ._field import Bounds, Field, open
from ._model import from_model
from ._native import __version__

__all__ = [
    "Bounds",
    "Error",
    "Field",
    "__version__",
    "bake",
    "from_arrays",
    "from_model",
    "open",
]
