"""The boxes of a world: the given box, and boxes around it, each with twice the size and twice the
node spacing of the previous one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Optional

import numpy as np

from . import _check, _native
from ._callback import Callback
from ._error import Error
from ._sample import Lattice

# Boxes around the first one, at most: the outermost is a million times as large.
_MOST = 20


def boxes_of(
    inner: Lattice, extent: Any, contraction: Optional[Callable[..., Any]], device: Any
) -> list[Lattice]:
    """`inner`, and boxes around it: out to `extent` half sides of `inner`, or as far as a
    contraction of space still resolves positions."""
    if extent is not None and contraction is not None:
        raise Error("contraction: found one beside extent, expected one of the two")
    if contraction is not None:
        count = _contracted(inner, Callback("contraction", contraction, 3, device))
    elif extent is not None:
        reach = _check.number("extent", extent, f"a number from 1 to {2**_MOST}", 0)
        if not 1 <= reach <= 2**_MOST:
            raise Error(f"extent: found {extent!r}, expected a number from 1 to {2**_MOST}")
        count = int(np.ceil(np.log2(reach)))
    else:
        count = 0
    boxes = [inner]
    for _ in range(count):
        last = boxes[-1]
        low, high, counts = _native.doubled(
            last.low.tolist(), last.high.tolist(), last.counts.tolist()
        )
        boxes.append(Lattice((low, high), counts))
    return boxes


def _contracted(inner: Lattice, contraction: Callback) -> int:
    """The number of boxes until doubling the distance covers less contracted space than the node
    spacing at the centre."""
    middle, half = (inner.low + inner.high) / 2, (inner.high - inner.low) / 2
    axis = int(np.argmax(half))
    away = np.zeros((_MOST + 4, 3))
    away[1, axis] = inner.spacing[axis]
    away[2:, axis] = half[axis] * 2.0 ** np.arange(_MOST + 2)
    found = contraction((middle + away).astype(np.float32)).astype(np.float64)
    node = float(np.linalg.norm(found[1] - found[0]))
    ways = np.linalg.norm(np.diff(found[2:], axis=0), axis=1)
    near = np.flatnonzero(ways < node)
    if node == 0 or not near.size or near[0] > _MOST:
        raise Error(
            f"contraction: found places {2**_MOST} half sides away as far apart as nodes in the "
            "middle, expected a function that contracts space",
            help="name extent instead",
        )
    return int(near[0])
