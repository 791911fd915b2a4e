"""View frusta of cameras: points outside all pictures need no samples."""

from __future__ import annotations

import json
import os
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _native

Doubles = npt.NDArray[np.float64]


class Frusta(NamedTuple):
    """The view frusta of cameras."""

    # Places, `[n, 3]`.
    eyes: Doubles
    # Unit axes of each, `[n, 3, 3]`: columns to the right, up and back.
    axes: Doubles
    # Slopes of the edges of pictures, `[n, 4]`: left, right, lower and upper.
    slopes: Doubles

    def see(self, centers: Doubles, radius: float) -> npt.NDArray[np.bool_]:
        """True for balls `[m, 3]` that may be partly visible in a picture."""
        seen = np.zeros(len(centers), dtype=bool)
        for eye, axes, (left, right, low, high) in zip(
            self.eyes, self.axes, self.slopes, strict=True
        ):
            unseen = np.flatnonzero(~seen)
            if not len(unseen):
                break
            x, y, back = ((centers[unseen] - eye) @ axes).T
            # Distances beyond the planes through the eye and the edges of the picture.
            beyond = [
                back,
                (x + right * back) / np.hypot(1, right),
                (-left * back - x) / np.hypot(1, left),
                (y + high * back) / np.hypot(1, high),
                (-low * back - y) / np.hypot(1, low),
            ]
            seen[unseen[np.max(beyond, axis=0) <= radius]] = True
        return seen

    def rays(self, count: int) -> tuple[Doubles, Doubles]:
        """Origins and unit directions of rays through pictures, spread evenly over the cameras and,
        by the R2 sequence, over the pictures. The base of the sequence solves x**3 = x + 1."""
        number = np.arange(count)
        # Of more cameras than rays, as many as there are rays.
        camera = number * max(1, len(self.eyes) // count) % len(self.eyes)
        shares = (0.5 + number[:, None] / 1.324717957244746 ** np.arange(1, 3)) % 1
        left, right, low, high = self.slopes[camera].T
        x = left + shares[:, 0] * (right - left)
        y = low + shares[:, 1] * (high - low)
        own = np.stack([x, y, np.full(count, -1.0)], axis=-1)
        ways = np.einsum("nij,nj->ni", self.axes[camera], own)
        return self.eyes[camera], ways / np.linalg.norm(ways, axis=1, keepdims=True)


def frusta_of(cameras: Any) -> Frusta:
    """The view frusta of a camera file, a COLMAP folder, or the same frames in a dictionary.

    Raises `Error` for cameras without a lens.
    """
    is_path = isinstance(cameras, (str, os.PathLike))
    text, path = (None, os.fspath(cameras)) if is_path else (json.dumps(cameras), None)
    matrices, slopes = _native.frusta(text, path)
    whole = np.asarray(matrices, dtype=np.float64).reshape(-1, 4, 4)
    axes = whole[:, :3, :3] / np.linalg.norm(whole[:, :3, :3], axis=1, keepdims=True)
    return Frusta(whole[:, :3, 3], axes, np.asarray(slopes, dtype=np.float64).reshape(-1, 4))
