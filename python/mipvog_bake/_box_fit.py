"""One box of samples: its occupied blocks, its densities, and colours fitted at its nodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Optional

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import Tensor, as_tensor
from ._callback import Callback
from ._frusta import Frusta
from ._sample import (
    EDGE,
    NODES,
    Lattice,
    Neighbours,
    fill_density,
    nodes_of,
    occupied_blocks,
)

# Steps, and the shares of a box's work between which they lie.
_SHARES = {"find matter": (0.0, 0.3), "sample density": (0.3, 0.6), "fit colours": (0.6, 1.0)}
# Directions that colours of a node are fitted along, at most.
_MOST_DIRECTIONS = 48
# Nodes whose colours judge the fit, at most.
_JUDGED = 4096


class Asked(NamedTuple):
    """The model to sample and the parameters of sampling."""

    density: Callback
    color: Callback
    # Points of a chunk.
    points: int
    # Coefficients of a colour.
    functions: int
    # Places of cameras.
    places: list[list[float]]
    # What they see, where their lenses are known.
    frusta: Optional[Frusta]
    # Called with the step and its share of the box's work.
    tell: Callable[[str, float], object]

    def step(self, step: str, share: float) -> None:
        """Reports the completed share of a step."""
        first, last = _SHARES[step]
        self.tell(step, first + (last - first) * share)


class Box:
    """A box and its occupied blocks, without those inside a smaller box if there is one.

    A box without matter has one empty block.
    """

    def __init__(self, lattice: Lattice, smaller: Optional[Lattice], asked: Asked) -> None:
        self.lattice, self._smaller = lattice, smaller
        found = occupied_blocks(
            lattice,
            smaller,
            asked.density,
            asked.points,
            asked.frusta,
            lambda share: asked.step("find matter", share),
        )
        self.has_blocks = len(found) > 0
        self.blocks = found if self.has_blocks else np.zeros((1, 3), dtype=np.int64)
        count, functions = len(self.blocks), asked.functions
        self._mean = np.zeros((count, NODES), dtype=np.float32)
        self._shift = np.zeros((count, NODES, 3), dtype=np.float16)
        self._sh = np.zeros((count, NODES, 3, functions), dtype=np.float16)

    @property
    def nodes(self) -> int:
        """Number of occupied nodes."""
        return int(np.count_nonzero(self._mean > self.lattice.faint))

    def fill(self, asked: Asked) -> None:
        """Samples densities."""
        if not self.has_blocks:
            return
        work = fill_density(
            self.lattice, asked.density, self.blocks, asked.points, self._mean, self._shift
        )
        for done in work:
            asked.step("sample density", done / len(self.blocks))

    def fit(self, asked: Asked) -> tuple[float, float]:
        """Fits colours. Returns the sum of squared errors along held-out directions, weighted by
        opacity, and the sum of opacities."""
        lattice, blocks, functions = self.lattice, self.blocks, asked.functions
        smaller = self._smaller
        inner = None if smaller is None else [smaller.low.tolist(), smaller.high.tolist()]
        own_arrays = _native.Arrays(self.tensors(""), {**self.texts(""), "block_size": str(EDGE)})
        degree = math.isqrt(functions) - 1
        fit = _native.NativeFit(own_arrays, degree, asked.places, inner)
        neighbours = Neighbours(lattice, blocks)
        nodes_at_once = max(1, asked.points // _MOST_DIRECTIONS)
        at_once = max(1, asked.points // NODES)
        for start in range(0, len(blocks), at_once):
            end = min(start + at_once, len(blocks))
            near, shifts = neighbours.shifts(self._mean, self._shift, lattice.faint, start, end)
            own = nodes_of(blocks[start:end])
            rows = np.argwhere(near & (own < lattice.counts).all(axis=-1))
            for first in range(0, len(rows), nodes_at_once):
                block, node = rows[first : first + nodes_at_once].T
                places_of = own[block, node] + shifts[block, node]
                nodes = np.ascontiguousarray(own[block, node])
                colors = _colors(lattice, asked.color, places_of, *fit.directions(nodes))
                found = fit.coefficients(nodes, colors.reshape(-1))
                self._sh[start + block, node] = found.reshape(-1, 3, functions)
            asked.step("fit colours", end / len(blocks))
        return self._held_out(asked.color, fit)

    def tensors(self, prefix: str) -> list[Tensor]:
        """The samples as sampled arrays. The arrays are borrowed and may still be filled later."""
        lattice, count, cube = self.lattice, len(self.blocks), (EDGE,) * 3
        corners = np.array([lattice.low, lattice.high], dtype=np.float32)
        small = self.blocks.astype(np.int32)
        shape = (count, *cube, 3, self._sh.shape[-1])
        return [
            as_tensor(f"{prefix}density", [self._mean], (count, *cube)),
            as_tensor(f"{prefix}sh", [self._sh], shape),
            as_tensor(f"{prefix}aabb", [corners], (2, 3)),
            (f"{prefix}blocks", "I32", [count, 3], [small.reshape(-1).view(np.uint8)]),
        ]

    def texts(self, prefix: str) -> dict[str, str]:
        """The settings of the sampled arrays."""
        return {f"{prefix}dimensions": ",".join(map(str, self.lattice.counts.tolist()))}

    def _held_out(self, color: Callback, fit: _native.NativeFit) -> tuple[float, float]:
        lattice = self.lattice
        rows = np.argwhere(self._mean > lattice.faint)
        rows = rows[np.linspace(0, len(rows) - 1, min(_JUDGED, len(rows))).astype(np.int64)]
        square, total = 0.0, 0.0
        for block, node in (part.T for part in np.array_split(rows, -(-len(rows) // 256) or 1)):
            if not len(node):
                continue
            own = np.ascontiguousarray(nodes_of(self.blocks[block])[np.arange(len(node)), node])
            directions, counts = fit.judges(own)
            true = _colors(lattice, color, own + self._shift[block, node], directions, counts)
            functions = self._sh.shape[-1]
            basis = _native.harmonics(directions.reshape(-1, 3), functions).reshape(-1, functions)
            coefficients = np.repeat(self._sh[block, node].astype(np.float32), counts, axis=0)
            fitted = np.maximum(0.5 + np.einsum("kcb,kb->kc", coefficients, basis), 0)
            depth = self._mean[block, node].astype(np.float64) * lattice.spacing.min()
            weights = np.repeat(1 - np.exp(-depth), counts)
            square += float((weights * ((fitted - true) ** 2).mean(axis=1)).sum())
            total += float(weights.sum())
        return square, total


def _colors(
    lattice: Lattice,
    color: Callback,
    nodes: npt.NDArray[Any],
    directions: npt.NDArray[np.float32],
    counts: npt.NDArray[np.int64],
) -> npt.NDArray[np.float32]:
    """Colours of nodes along directions, `counts` per node."""
    return color(np.repeat(lattice.place(nodes), counts, axis=0), directions.reshape(-1, 3))
