"""`from_model`: makes a field from samples of any model."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Optional, Union

import numpy as np

from . import _check, _native
from ._box_fit import Asked, Box
from ._boxes import boxes_of
from ._callback import Callback
from ._error import Error
from ._field import Field
from ._frusta import Frusta, frusta_of
from ._judge import judge
from ._progress import Progress, shown
from ._sample import (
    EDGE,
    LEAST_POINTS,
    MOST_POINTS,
    NODES,
    POINT_BYTES,
    Lattice,
    seen_blocks,
)

# The share of the work after which pictures are judged.
_JUDGING = 0.95
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
    extent: Optional[float] = None,
    contraction: Optional[Callable[..., Any]] = None,
    progress: Union[None, bool, Progress] = None,
) -> Field:
    """Samples a model and returns a field for `bake`.

    `density(positions[n, 3])` returns `[n]`, optical depth per world unit.
    `color(positions[n, 3], directions[n, 3])` returns `[n, 3]`, 0 to 1: the colour of matter along
    unit directions that point into the scene. Both get float32 NumPy arrays, or torch tensors on
    `device`; both may return either.

    `bounds` are two corners of a box in world units. `resolution` is the number of nodes along the
    longest axis, or along each axis. Occupied blocks are found first. Densities are means over
    voxels. Colours are harmonics of degree `sh_degree`, 0 to 3, fitted along the directions from
    which each node is seen. These directions come from `cameras`: a camera file, a COLMAP folder,
    their frames in a dictionary, positions `[n, 3]`, or camera-to-world matrices. With fewer than
    16 cameras, they come from all around. If the cameras have lenses, as in files and frames, parts
    that no picture shows are not sampled.

    A world extends beyond `bounds`. With `extent`, boxes around `bounds` are sampled, each with
    twice the size and node spacing of the previous one, until one reaches `extent` half sides from
    the centre. Alternatively, the model's own `contraction(positions[n, 3]) -> [n, 3]` decides how
    far the boxes reach. The surroundings are seen from `cameras`, or from inside `bounds`.

    `max_memory` limits the bytes that this function uses, without those of the model itself. A
    limit that is too small for the samples is refused, immediately if possible. Smaller limits also
    mean smaller batches. `progress` is as in `bake`: a function of the step and the completed share
    of all work, or True for a bar.

    The field's `report` has the number of samples and bytes; `view.held_out_psnr`, the error of the
    fit along held-out directions; and `picture_psnr`, the error of rays through the field against
    rays through the model. Samples miss matter thinner than a node spacing: if the rays show this,
    a warning says so.
    """
    with shown(progress) as tell:
        return _sampled(
            density,
            color,
            boxes_of(Lattice(bounds, resolution), extent, contraction, device),
            _check.color("background", background),
            _check.whole("sh_degree", sh_degree, "0, 1, 2 or 3", 0, 3),
            device,
            max_memory,
            *_seen_from(cameras),
            tell or (lambda step, share: None),
        )


def _sampled(
    density: Callable[..., Any],
    color: Callable[..., Any],
    lattices: list[Lattice],
    behind: list[float],
    sh_degree: int,
    device: Any,
    max_memory: Optional[int],
    places: list[list[float]],
    frusta: Optional[Frusta],
    show: Progress,
) -> Field:
    clock = time.perf_counter()
    ask_density = Callback("density", density, 1, device)
    ask_color = Callback("color", color, 3, device)
    points = _points(max_memory)
    functions = (sh_degree + 1) ** 2
    # Before the scan, which may take hours: no model needs less than this for one block a box.
    _needed(lattices, len(lattices), functions, points, max_memory)

    boxes: list[Box] = []
    square, total = 0.0, 0.0
    for number, lattice in enumerate(lattices):

        def tell(step: str, share: float, number: int = number) -> None:
            show(step, _JUDGING * (number + share) / len(lattices))

        asked = Asked(ask_density, ask_color, points, functions, places, frusta, tell)
        tell("find matter", 0.0)
        box = Box(lattice, lattices[number - 1] if number else None, asked)
        boxes.append(box)
        blocks = sum(len(box.blocks) for box in boxes)
        needed = _needed(lattices, blocks, functions, points, max_memory)
        box.fill(asked)
        # Nodes may see some that the samples of their voxels do not.
        if box.nodes > 0:
            own_square, own_total = box.fit(asked)
            square, total = square + own_square, total + own_total
    if not any(box.nodes for box in boxes):
        raise _no_matter(lattices[-1])
    show("judge", _JUDGING)
    error = square / max(total, 1e-30)
    psnr = min(200.0, -10 * math.log10(max(error, 1e-30)))
    samples = {"density_samples": ask_density.rows, "color_samples": ask_color.rows}
    field = Field.of_arrays(_arrays(boxes, behind))
    pictures = judge(field, lattices, ask_density, ask_color, behind, points, frusta)
    show("judge", 1.0)
    report = {
        **samples,
        "nodes": sum(box.nodes for box in boxes),
        "blocks": sum(len(box.blocks) for box in boxes),
        "blocks_total": sum(int(lattice.blocks.prod()) for lattice in lattices),
        "blocks_seen": sum(int(seen_blocks(lattice, frusta).sum()) for lattice in lattices),
        "boxes": len(boxes),
        "bytes": needed,
        "points_at_once": points,
        "seconds": time.perf_counter() - clock,
        "view": {"fitted": True, "degree": sh_degree, "held_out_psnr": psnr},
        **pictures,
    }
    field._report = report
    return field


def _needed(
    lattices: list[Lattice], blocks: int, functions: int, points: int, max_memory: Optional[int]
) -> int:
    """Bytes for a number of occupied blocks. Refuses more than the limit."""
    # Values of nodes, and the number of each block of the boxes.
    numbers = 8 * sum(int(lattice.blocks.prod()) for lattice in lattices)
    held = blocks * NODES * (4 + 6 + 6 * functions) + numbers
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
    """Points per chunk: an eighth of the memory, within limits."""
    if max_memory is None:
        return MOST_POINTS
    bound = _check.whole("max_memory", max_memory, "a number of bytes above 0", 1)
    return min(MOST_POINTS, max(LEAST_POINTS, bound // 8 // POINT_BYTES))


def _arrays(boxes: list[Box], background: list[float]) -> _native.Arrays:
    """All boxes as sampled arrays."""
    texts = {
        "block_size": str(EDGE),
        "background": ",".join(map(repr, background)),
        "offset": "0.5",
        "clamp": "zero",
    }
    tensors = []
    for number, box in enumerate(boxes):
        prefix = f"level{number}." if number else ""
        tensors += box.tensors(prefix)
        texts |= box.texts(prefix)
    return _native.Arrays(tensors, texts)


def _no_matter(lattice: Lattice) -> Error:
    return Error(
        f"density: found no matter in the box {lattice.low.tolist()} to "
        f"{lattice.high.tolist()}, expected some",
        kind="malformed",
        exit_code=3,
        help="check bounds, and that density is per world unit",
    )


def _seen_from(cameras: Any) -> tuple[list[list[float]], Optional[Frusta]]:
    """The positions of cameras and, if they have lenses, their view frusta."""
    if cameras is None:
        return [], None
    if isinstance(cameras, (str, os.PathLike, Mapping)):
        frusta = frusta_of(cameras)
        eyes: list[list[float]] = frusta.eyes.tolist()
        return eyes, frusta
    expected = "a camera file, finite places [n, 3] or matrices [n, 4, 4]"
    found = _check.numbers("cameras", cameras, expected)
    if found.ndim == 3 and found.shape[1:] in ((3, 4), (4, 4)):
        found = found[:, :3, 3]
    if found.ndim != 2 or found.shape[1] != 3 or not np.isfinite(found).all():
        raise Error(f"cameras: found shape {found.shape}, expected {expected}")
    rows: list[list[float]] = found.tolist()
    return rows, None
