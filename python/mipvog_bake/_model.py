"""`from_model`: a field of samples of anybody's model."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _check, _native
from ._arrays import as_tensor
from ._callback import Callback
from ._error import Error
from ._field import Field
from ._judge import judge
from ._progress import Progress, shown
from ._sample import (
    EDGE,
    LEAST_POINTS,
    MOST_POINTS,
    NODES,
    POINT_BYTES,
    Lattice,
    Neighbours,
    fill_density,
    nodes_of,
    occupied_blocks,
)

# Steps, and the shares of the work between which they lie.
_SHARES = {
    "find matter": (0.0, 0.3),
    "sample density": (0.3, 0.6),
    "fit colours": (0.6, 0.95),
    "judge": (0.95, 1.0),
}
# Directions that colours of a node are fitted along, at most.
_MOST_DIRECTIONS = 48
# Nodes whose colours judge the fit, at most.
_JUDGED = 4096
# What the fit's own tables take: the views of 64 cells a side, twice.
_FIT_BYTES = 24 << 20


def from_model(
    density: Callable[..., Any],
    color: Callable[..., Any],
    *,
    bounds: Any,
    resolution: Union[int, Sequence[int]],
    background: Sequence[float] = (1.0, 1.0, 1.0),
    sh_degree: int = 2,
    device: Any = None,
    max_memory: Optional[int] = None,
    cameras: Any = None,
    progress: Union[None, bool, Progress] = None,
) -> Field:
    """Samples a model, and gives a field that `bake` takes.

    `density(positions[n, 3])` gives `[n]`, optical depth per world unit. `color(positions[n, 3],
    directions[n, 3])` gives `[n, 3]`, 0 to 1, of matter seen along unit directions that point into
    the scene. Both get float32 arrays of NumPy, or tensors of torch on `device`; both may give
    either.

    `bounds` are two corners of a box in world units. `resolution` is the number of nodes along its
    longest axis, or along each. Occupied blocks are found first; densities are means over voxels,
    and colours harmonics of `sh_degree`, 0 to 3, that are fitted along the directions from which a
    node is seen: from `cameras` (a camera file, places `[n, 3]`, or matrices from camera to world),
    or from all around without at least 16.

    `max_memory` bounds the bytes that this function takes beside the model itself; less than what
    the samples need is refused, at once where that is known. Smaller bounds also mean smaller
    batches. `progress` is as in `bake`: a function of the step and the share of all the work, or
    True for a bar.

    The field's `report` has the number of samples, the bytes, the error of the fit along
    directions that no fit has seen, `view.held_out_psnr`, and `picture_psnr`, that of rays through
    the field against rays through the model. Matter thinner than a node spacing is lost to samples:
    a warning says so where rays tell.
    """
    with shown(progress) as tell:
        return _sampled(
            density,
            color,
            Lattice(bounds, resolution),
            _check.color("background", background),
            _check.whole("sh_degree", sh_degree, "0, 1, 2 or 3", 0, 3),
            device,
            max_memory,
            _places(cameras),
            tell or (lambda step, share: None),
        )


def _sampled(
    density: Callable[..., Any],
    color: Callable[..., Any],
    lattice: Lattice,
    behind: list[float],
    sh_degree: int,
    device: Any,
    max_memory: Optional[int],
    places: list[list[float]],
    show: Progress,
) -> Field:
    clock = time.perf_counter()

    def tell(step: str, share: float) -> None:
        first, last = _SHARES[step]
        show(step, first + (last - first) * share)

    ask_density = Callback("density", density, 1, device)
    ask_color = Callback("color", color, 3, device)
    points = _points(max_memory)
    functions = (sh_degree + 1) ** 2
    # Before the scan, which may take hours: no model needs less than this for one block.
    _needed(lattice, 1, functions, points, max_memory)

    tell("find matter", 0.0)
    blocks = occupied_blocks(lattice, ask_density, points, partial(tell, "find matter"))
    if len(blocks) == 0:
        raise _no_matter(lattice)
    needed = _needed(lattice, len(blocks), functions, points, max_memory)
    mean = np.zeros((len(blocks), NODES), dtype=np.float32)
    shift = np.zeros((len(blocks), NODES, 3), dtype=np.float16)
    for done in fill_density(lattice, ask_density, blocks, points, mean, shift):
        tell("sample density", done / len(blocks))

    sh = np.zeros((len(blocks), NODES, 3, functions), dtype=np.float16)
    arrays = _arrays(lattice, blocks, mean, sh, behind)
    fit = _native.NativeFit(arrays, sh_degree, places)
    matter = mean > lattice.faint
    if not matter.any():
        # Nodes saw some that the samples of their voxels did not.
        raise _no_matter(lattice)
    neighbours = Neighbours(lattice, blocks)
    nodes_at_once = max(1, points // _MOST_DIRECTIONS)
    at_once = max(1, points // NODES)
    for start in range(0, len(blocks), at_once):
        end = min(start + at_once, len(blocks))
        near, shifts = neighbours.shifts(mean, shift, lattice.faint, start, end)
        own = nodes_of(blocks[start:end])
        rows = np.argwhere(near & (own < lattice.counts).all(axis=-1))
        for first in range(0, len(rows), nodes_at_once):
            block, node = rows[first : first + nodes_at_once].T
            places_of = own[block, node] + shifts[block, node]
            asked = np.ascontiguousarray(own[block, node])
            colors = _colors(lattice, ask_color, places_of, *fit.directions(asked))
            found = fit.coefficients(asked, colors.reshape(-1))
            sh[start + block, node] = found.reshape(-1, 3, functions)
        tell("fit colours", end / len(blocks))
    tell("judge", 0.0)
    psnr = _held_out(lattice, ask_color, fit, blocks, (mean, shift, sh))
    samples = {"density_samples": ask_density.rows, "color_samples": ask_color.rows}
    field = Field.of_arrays(arrays)
    pictures = judge(field, lattice, ask_density, ask_color, behind, points)
    tell("judge", 1.0)
    report = {
        **samples,
        "nodes": int(np.count_nonzero(matter)),
        "blocks": len(blocks),
        "blocks_total": int(lattice.blocks.prod()),
        "bytes": needed,
        "points_at_once": points,
        "seconds": time.perf_counter() - clock,
        "view": {"fitted": True, "degree": sh_degree, "held_out_psnr": psnr},
        **pictures,
    }
    field._report = report
    return field


def _needed(
    lattice: Lattice, blocks: int, functions: int, points: int, max_memory: Optional[int]
) -> int:
    """Bytes for so many blocks with matter. Refuses more than the bound."""
    # Values of nodes, and the number of each block of the box.
    held = blocks * NODES * (4 + 6 + 6 * functions) + 8 * int(lattice.blocks.prod())
    needed = held + _FIT_BYTES + points * POINT_BYTES
    if max_memory is not None and needed > max_memory:
        raise Error(
            f"from_model needs {needed} bytes or more for {blocks} occupied blocks, the bound is "
            f"{max_memory}",
            kind="too_little_memory",
            exit_code=6,
            help=f"allow max_memory={needed} or more, or lower resolution",
        )
    return needed


def _points(max_memory: Optional[int]) -> int:
    """Points of a chunk: an eighth of the memory, within limits."""
    if max_memory is None:
        return MOST_POINTS
    bound = _check.whole("max_memory", max_memory, "a number of bytes above 0", 1)
    return min(MOST_POINTS, max(LEAST_POINTS, bound // 8 // POINT_BYTES))


def _arrays(
    lattice: Lattice,
    blocks: npt.NDArray[np.int64],
    mean: npt.NDArray[np.float32],
    sh: npt.NDArray[np.float16],
    background: list[float],
) -> _native.Arrays:
    """The samples as sampled arrays. They are borrowed, and may still be filled."""
    count, cube, functions = len(blocks), (EDGE,) * 3, sh.shape[-1]
    corners = np.array([lattice.low, lattice.high], dtype=np.float32)
    small = blocks.astype(np.int32)
    tensors = [
        as_tensor("density", [mean], (count, *cube)),
        as_tensor("sh", [sh], (count, *cube, 3, functions)),
        as_tensor("aabb", [corners], (2, 3)),
        ("blocks", "I32", [count, 3], [small.reshape(-1).view(np.uint8)]),
    ]
    texts = {
        "block_size": str(EDGE),
        "dimensions": ",".join(map(str, lattice.counts.tolist())),
        "background": ",".join(map(repr, background)),
        "offset": "0.5",
        "clamp": "zero",
    }
    return _native.Arrays(tensors, texts)


def _colors(
    lattice: Lattice,
    color: Callback,
    nodes: npt.NDArray[Any],
    directions: npt.NDArray[np.float32],
    counts: npt.NDArray[np.int64],
) -> npt.NDArray[np.float32]:
    """Colours of nodes along directions, `counts` of them for each."""
    return color(np.repeat(lattice.place(nodes), counts, axis=0), directions.reshape(-1, 3))


def _held_out(
    lattice: Lattice,
    color: Callback,
    fit: _native.NativeFit,
    blocks: npt.NDArray[np.int64],
    values: tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]],
) -> float:
    """PSNR of fitted colours, weighted by opacity, along directions that no fit has seen."""
    mean, shift, sh = values
    rows = np.argwhere(mean > lattice.faint)
    rows = rows[np.linspace(0, len(rows) - 1, min(_JUDGED, len(rows))).astype(np.int64)]
    square, total = 0.0, 0.0
    for block, node in (part.T for part in np.array_split(rows, -(-len(rows) // 256))):
        own = np.ascontiguousarray(nodes_of(blocks[block])[np.arange(len(node)), node])
        directions, counts = fit.judges(own)
        true = _colors(lattice, color, own + shift[block, node], directions, counts)
        functions = sh.shape[-1]
        basis = _native.harmonics(directions.reshape(-1, 3), functions).reshape(-1, functions)
        coefficients = np.repeat(sh[block, node].astype(np.float32), counts, axis=0)
        fitted = np.maximum(0.5 + np.einsum("kcb,kb->kc", coefficients, basis), 0)
        opacity = 1 - np.exp(-mean[block, node].astype(np.float64) * lattice.spacing.min())
        weights = np.repeat(opacity, counts)
        square += float((weights * ((fitted - true) ** 2).mean(axis=1)).sum())
        total += float(weights.sum())
    error = square / max(total, 1e-30)
    return min(200.0, -10 * math.log10(max(error, 1e-30)))


def _no_matter(lattice: Lattice) -> Error:
    return Error(
        f"density: found no matter in the box {lattice.low.tolist()} to "
        f"{lattice.high.tolist()}, expected some",
        kind="malformed",
        exit_code=3,
        help="check bounds, and that density is per world unit",
    )


def _places(cameras: Any) -> list[list[float]]:
    """The places of cameras."""
    if cameras is None:
        return []
    if isinstance(cameras, (str, os.PathLike)):
        name = os.fspath(cameras)
        try:
            with open(name, encoding="utf-8") as file:
                frames = json.load(file)["frames"]
            cameras = [frame["transform_matrix"] for frame in frames]
        except OSError as error:
            raise Error(
                f"{name}: {error.strerror}", "io", name, None, 5, "check the path"
            ) from error
        except (ValueError, KeyError, TypeError) as error:
            raise Error(
                f"{name}: found no camera file ({error}), expected frames with transform_matrix",
                kind="wrong_kind",
                file=name,
                exit_code=3,
            ) from error
    expected = "a camera file, finite places [n, 3] or matrices [n, 4, 4]"
    found = _check.numbers("cameras", cameras, expected)
    if found.ndim == 3 and found.shape[1:] in ((3, 4), (4, 4)):
        found = found[:, :3, 3]
    if found.ndim != 2 or found.shape[1] != 3 or not np.isfinite(found).all():
        raise Error(f"cameras: found shape {found.shape}, expected {expected}")
    rows: list[list[float]] = found.tolist()
    return rows
