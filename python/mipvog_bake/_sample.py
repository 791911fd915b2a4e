"""Density of any model at the nodes of a box: finds occupied blocks, then samples only those.

A block has 8 nodes per side. Every node is tested once. A block is kept if any of its nodes or of
their neighbours holds matter. In kept blocks, the density of a node is the mean over its voxel, of
8 samples:

    density = -log(mean of exp(-h d)) / h        h the node spacing, d the samples' densities

This density transmits as much light as the voxel. In thin matter, it equals the mean of `d`; at a
hard surface, a half-empty voxel stays half transparent. The `shift` of a node points to the centre
of the matter around it, where its colour is sampled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _check
from ._arrays import corners
from ._callback import Callback
from ._error import Error
from ._frusta import Frusta

EDGE = 8
NODES = EDGE**3
# Opacity over one node spacing from which a node holds matter.
FAINT = 1e-4
# Samples of a node's voxel, in node spacings from the node.
SUBSAMPLES = np.array(list(product((-0.25, 0.25), repeat=3)))
# Bytes that a point takes while a chunk is worked on: its numbers, and copies of them.
POINT_BYTES = 192
# Points of a chunk, at most and at least.
MOST_POINTS, LEAST_POINTS = 1 << 17, 1 << 12

Bools = npt.NDArray[np.bool_]
Doubles = npt.NDArray[np.float64]


class Lattice:
    """Nodes of a box: `counts` along each axis, the outermost on its faces."""

    def __init__(self, bounds: Any, resolution: Union[int, Sequence[int]]) -> None:
        self.low, self.high = corners("bounds", bounds)
        extent = self.high - self.low
        expected = "2 to 4096 nodes along the longest axis, or along each of three"
        sides = np.atleast_1d(_check.numbers("resolution", resolution, expected))
        in_range = (sides >= 2) & (sides <= 4096) & (sides == np.rint(sides))
        if sides.shape not in ((1,), (3,)) or not in_range.all():
            raise Error(f"resolution: found {resolution!r}, expected {expected}")
        if len(sides) == 1:
            sides = np.maximum(np.rint(extent / extent.max() * (sides - 1)) + 1, 2)
        self.counts = sides.astype(np.int64)
        self.spacing = extent / (self.counts - 1)
        self.blocks = -(-self.counts // EDGE)

    def place(self, nodes: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """The positions of nodes, whose indices may be fractions, clamped to the box."""
        places: Doubles = self.low + nodes * self.spacing
        return np.clip(places, self.low, self.high).astype(np.float32)

    @property
    def faint(self) -> float:
        """Nodes of greater density hold matter."""
        return FAINT / float(self.spacing.min())


def occupied_blocks(
    lattice: Lattice,
    smaller: Optional[Lattice],
    density: Callback,
    points: int,
    frusta: Optional[Frusta],
    tell: Callable[[float], object],
) -> npt.NDArray[np.int64]:
    """The blocks that hold matter or touch one that does, `[n, 3]`, in order. Places more than a
    node inside a smaller box are not tested, nor are blocks outside all `frusta`. `tell` is called
    with the share of tested nodes."""
    blocks = lattice.blocks
    kept = np.zeros(blocks, dtype=bool)
    seen = seen_blocks(lattice, frusta)
    ny, nz = lattice.counts[1:]
    for layer in range(blocks[0]):
        first = layer * EDGE
        count = min(EDGE, int(lattice.counts[0]) - first)
        matter = np.zeros((count, blocks[1] * EDGE, blocks[2] * EDGE), dtype=bool)
        flat = np.empty(count * ny * nz, dtype=bool)
        for start in range(0, flat.size, points):
            index = np.arange(start, min(start + points, flat.size))
            x, y, z = np.unravel_index(index, (count, ny, nz))
            places = lattice.place(np.stack([x + first, y, z], axis=-1))
            asked = _outside(places, lattice, smaller) & seen[layer, y // EDGE, z // EDGE]
            flat[index] = False
            if asked.any():
                flat[index[asked]] = density(places[asked]) > lattice.faint
            tell((first * ny * nz + index[-1] + 1) / int(lattice.counts.prod()))
        matter[:, :ny, :nz] = flat.reshape(count, ny, nz)
        kept[layer] |= _blocks_near(np.asarray(matter.any(axis=0)))
        if layer > 0:
            kept[layer - 1] |= _blocks_near(matter[0])
        if layer + 1 < blocks[0]:
            kept[layer + 1] |= _blocks_near(matter[-1])
    return np.argwhere(kept & seen)


def seen_blocks(lattice: Lattice, frusta: Optional[Frusta]) -> Bools:
    """True for blocks whose cells may be visible in a picture. Cells extend to the nodes of the
    next blocks on both sides."""
    if frusta is None:
        return np.ones(lattice.blocks, dtype=bool)
    numbers = np.argwhere(np.ones(lattice.blocks, dtype=bool))
    centers = lattice.low + (numbers * EDGE + 0.5 * (EDGE - 1)) * lattice.spacing
    radius = 0.5 * (EDGE + 1) * float(np.linalg.norm(lattice.spacing))
    return frusta.see(centers, radius).reshape(lattice.blocks)


def _outside(
    places: npt.NDArray[np.float32], lattice: Lattice, smaller: Optional[Lattice]
) -> Bools:
    """True for places that are not deep inside a smaller box."""
    if smaller is None:
        return np.ones(len(places), dtype=bool)
    low, high = smaller.low + lattice.spacing, smaller.high - lattice.spacing
    outside: Bools = np.asarray(((places < low) | (places > high)).any(axis=1))
    return outside


def _blocks_near(plane: npt.NDArray[Any]) -> Bools:
    """Blocks of a plane that contain or touch a marked node."""
    grown = _grown(_grown(plane, 0), 1)
    ny, nz = grown.shape
    blocks = grown.reshape(ny // EDGE, EDGE, nz // EDGE, EDGE)
    near: Bools = np.asarray(blocks.any(axis=(1, 3)))
    return near


def _grown(values: Bools, axis: int) -> Bools:
    """Adds the neighbours along an axis of all marked nodes."""
    grown = values.copy()
    ahead = [slice(None)] * values.ndim
    behind = [slice(None)] * values.ndim
    ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
    grown[tuple(ahead)] |= values[tuple(behind)]
    grown[tuple(behind)] |= values[tuple(ahead)]
    return grown


def nodes_of(blocks: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """The nodes of blocks, `[n, 512, 3]`."""
    own = np.stack(np.unravel_index(np.arange(NODES), (EDGE,) * 3), axis=-1)
    return blocks[:, None] * EDGE + own


def fill_density(
    lattice: Lattice,
    density: Callback,
    blocks: npt.NDArray[np.int64],
    points: int,
    mean: npt.NDArray[np.float32],
    shift: npt.NDArray[np.float16],
) -> Iterator[int]:
    """Fills `mean` `[n, 512]` and `shift` `[n, 512, 3]` chunk by chunk; yields the number of
    finished blocks."""
    chunk = max(1, points // (NODES * len(SUBSAMPLES)))
    for start in range(0, len(blocks), chunk):
        nodes = nodes_of(blocks[start : start + chunk])
        samples = (nodes[:, :, None] + SUBSAMPLES).reshape(-1, 3)
        found = np.concatenate([density(lattice.place(part)) for part in _parts(samples, points)])
        found = np.maximum(found, 0).reshape(*nodes.shape[:2], len(SUBSAMPLES))
        found[(nodes >= lattice.counts).any(axis=-1)] = 0
        spacing = float(lattice.spacing.min())
        least = found.min(axis=-1)
        # Without the least density, which all samples share, no exponential is too small.
        light = np.exp(-spacing * (found - least[..., None]), dtype=np.float64).mean(axis=-1)
        total = found.sum(axis=-1, keepdims=True)
        weights = np.divide(found, total, out=np.zeros_like(found), where=total > 0)
        end = start + len(nodes)
        mean[start:end] = least - np.log(light) / spacing
        shift[start:end] = weights @ SUBSAMPLES
        yield end


def _parts(rows: npt.NDArray[Any], count: int) -> Iterator[npt.NDArray[Any]]:
    for start in range(0, len(rows), count):
        yield rows[start : start + count]


class Neighbours:
    """Reads the neighbours of nodes, across the borders of blocks."""

    def __init__(self, lattice: Lattice, blocks: npt.NDArray[np.int64]) -> None:
        self._blocks = blocks
        # A border of one block on every side: no block is there.
        self._numbers = np.full(lattice.blocks + 2, -1, dtype=np.int64)
        self._numbers[tuple((blocks + 1).T)] = np.arange(len(blocks))

    def shifts(
        self,
        mean: npt.NDArray[np.float32],
        shift: npt.NDArray[np.float16],
        faint: float,
        start: int,
        end: int,
    ) -> tuple[Bools, npt.NDArray[np.float16]]:
        """For blocks `start` to `end`: the nodes with matter or beside matter, `[n, 512]`, and
        their shifts towards it, `[n, 512, 3]`. The shift of a node without matter points to the
        centre of its neighbours' matter."""
        density = self._padded(mean, start, end)
        matter = density > faint
        near = matter
        for axis in (1, 2, 3):
            near = _grown(near, axis)
        places = self._padded(shift, start, end).astype(np.float32)
        weights = np.where(matter, density, 0)[..., None]
        total = np.zeros((end - start, EDGE, EDGE, EDGE, 1), dtype=np.float32)
        sums = np.zeros((end - start, EDGE, EDGE, EDGE, 3), dtype=np.float32)
        for way in product((-1, 0, 1), repeat=3):
            window = (slice(None), *(slice(1 + step, 1 + step + EDGE) for step in way))
            total += weights[window]
            sums += weights[window] * (places[window] + np.array(way, dtype=np.float32))
        inner = (slice(None), *[slice(1, -1)] * 3)
        around = np.divide(sums, total, out=np.zeros_like(sums), where=total > 0)
        found = np.where(matter[inner][..., None], places[inner], around).astype(np.float16)
        return near[inner].reshape(-1, NODES), found.reshape(-1, NODES, 3)

    def _padded(self, values: npt.NDArray[Any], start: int, end: int) -> npt.NDArray[Any]:
        """Values of blocks `start` to `end` with a border of one node around each block,
        `[n, 10, 10, 10, ...]` from `[n, 512, ...]`. Borders without a block are 0."""
        own, rest = self._blocks[start:end], values.shape[2:]
        padded = np.zeros((len(own), *(EDGE + 2,) * 3, *rest), dtype=values.dtype)
        # Of the block before only its last node, of the one behind only its first.
        to = {-1: slice(0, 1), 0: slice(1, -1), 1: slice(-1, None)}
        of = {-1: slice(-1, None), 0: slice(None), 1: slice(0, 1)}
        for way in product((-1, 0, 1), repeat=3):
            numbers = self._numbers[tuple((own + 1 + way).T)]
            there = numbers >= 0
            blocks = values[numbers[there]].reshape(-1, EDGE, EDGE, EDGE, *rest)
            target = (there, *(to[step] for step in way))
            padded[target] = blocks[(slice(None), *(of[step] for step in way))]
        return padded
