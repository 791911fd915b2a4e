"""Compares pictures of a sampled model with the model's own, by rays marched through both.

Samples at voxels miss some errors: the field transmits light through matter thinner than a node
spacing, which the model blocks. Only rays show this.
"""

from __future__ import annotations

import math
import warnings
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from ._callback import Callback
from ._field import Field
from ._frusta import Frusta
from ._sample import Lattice

# Rays, and samples of one in a node spacing.
RAYS, SAMPLES = 192, 8
# Distance of eyes from the middle of the box, in half diagonals.
_EYE = 3.0
# Light that is left behind what nobody sees any more, and the least weight of a colour that counts.
_OPAQUE, _LEAST = 1e-3, 1e-3
# A field whose rays keep more light than the model's, by this on average, has lost matter.
_LOST = 0.05

Doubles = npt.NDArray[np.float64]


def judge(
    field: Field,
    lattices: list[Lattice],
    density: Callback,
    color: Callback,
    background: list[float],
    points: int,
    frusta: Optional[Frusta],
) -> dict[str, float]:
    """Marches rays of the cameras, if they have lenses. Otherwise, rays come from all around
    through the central parts of the box or, in a world, from inside its first box. `picture_psnr`
    compares the colours of field and model; the transmittances are means over the rays, of the
    field and of the model."""
    lattice = lattices[0]
    if frusta is not None:
        origins, ways = frusta.rays(RAYS)
    elif len(lattices) == 1:
        origins, ways = _rays(lattice)
    else:
        origins, ways = _looks(lattice, density)
    own, left = _march(lattices, density, color, background, points, origins, ways)
    rgb, shown, _ = field.probe(origins, ways)
    square = float(((np.clip(rgb, 0, 1) - np.clip(own, 0, 1)) ** 2).mean())
    found = {
        "picture_psnr": min(200.0, -10 * math.log10(max(square, 1e-20))),
        "transmittance": float(shown.mean()),
        "model_transmittance": float(left.mean()),
    }
    if found["transmittance"] - found["model_transmittance"] > _LOST:
        warnings.warn(
            f"rays keep {found['transmittance']:.3f} of their light in the field and "
            f"{found['model_transmittance']:.3f} in the model: it has matter thinner than a node "
            f"spacing of {lattice.spacing.min():.3g}, so raise resolution",
            stacklevel=3,
        )
    return found


def _rays(lattice: Lattice) -> tuple[Doubles, Doubles]:
    """Origins on a sphere around the box, and unit directions to points inside the box."""
    extent = lattice.high - lattice.low
    middle = 0.5 * (lattice.high + lattice.low)
    origins = middle + _sphere() * _EYE * 0.5 * float(np.linalg.norm(extent))
    ways = _inside(lattice) - origins
    return origins, ways / np.linalg.norm(ways, axis=1, keepdims=True)


def _sphere() -> Doubles:
    """Unit vectors in all directions, on a spiral."""
    number = np.arange(RAYS)
    height = 1 - (2 * number + 1) / RAYS
    around = number * math.pi * (3 - math.sqrt(5))
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.cos(around), flat * np.sin(around), height], axis=-1)


def _inside(lattice: Lattice) -> Doubles:
    """Points inside a box, spread evenly by the R3 sequence. The base of the sequence solves x**4 =
    x + 1."""
    shares = (0.5 + np.arange(RAYS)[:, None] / 1.2207440846057596 ** np.arange(1, 4)) % 1
    places: Doubles = lattice.low + (0.15 + 0.7 * shares) * (lattice.high - lattice.low)
    return places


def _looks(lattice: Lattice, density: Callback) -> tuple[Doubles, Doubles]:
    """Origins at empty places in a box, and unit directions all around."""
    places = _inside(lattice)
    free = places[density(places.astype(np.float32)) <= lattice.faint]
    places = np.resize(free, places.shape) if len(free) else places
    return places, _sphere()


def _edges(lattice: Lattice, far: float) -> tuple[Doubles, Doubles]:
    """Starts and lengths of the steps of rays from inside a box. Lengths double with the distance:
    beyond the diagonal of a box, a ray has left it."""
    step = float(lattice.spacing.min()) / SAMPLES
    reach = float(np.linalg.norm(lattice.high - lattice.low))
    starts, widths, at = [], [], 0.0
    while at < far:
        end = min(reach, far)
        count = max(1, math.ceil((end - at) / step))
        starts.append(at + np.arange(count) * step)
        widths.append(np.full(count, step))
        at, reach, step = at + count * step, 2 * reach, 2 * step
    return np.concatenate(starts), np.concatenate(widths)


def _march(
    lattices: list[Lattice],
    density: Callback,
    color: Callback,
    background: list[float],
    points: int,
    origins: Doubles,
    ways: Doubles,
) -> tuple[Doubles, Doubles]:
    """Colours and transmittances of rays through the model itself, up to where they leave the last
    box."""
    last = lattices[-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        faces = np.stack([last.low - origins, last.high - origins]) / ways
    near = np.maximum(np.nanmin(faces, axis=0).max(axis=1), 0)
    far = np.nanmax(faces, axis=0).min(axis=1)
    # Half a step, other for every ray: no surface lies between the samples of all.
    offset = (0.5 + np.arange(len(ways)) * 0.6180339887498949) % 1
    if len(lattices) == 1:
        step = float(last.spacing.min()) / SAMPLES
        count = max(0, int(np.max((far - near) / step)) + 2)
        starts, widths = np.arange(count) * step, np.full(count, step)
    else:
        starts, widths = _edges(lattices[0], float(far.max()))
    reach = (far - near)[:, None] >= starts + offset[:, None] * widths
    steps = reach.sum(axis=1)
    rgb, left = np.zeros((len(ways), 3)), np.ones(len(ways))
    at_once = max(1, points // max(1, int(steps.max(initial=0))))
    for first in range(0, len(ways), at_once):
        own = np.arange(first, min(first + at_once, len(ways)))
        ray = np.repeat(own, steps[own])
        if not ray.size:
            continue
        firsts = np.cumsum(steps[own]) - steps[own]
        number = np.arange(ray.size) - np.repeat(firsts, steps[own])
        t = near[ray] + starts[number] + offset[ray] * widths[number]
        places = (origins[ray] + t[:, None] * ways[ray]).astype(np.float32)
        depth = np.concatenate(
            [density(places[at : at + points]) for at in range(0, len(places), points)]
        )
        depth = np.maximum(depth, 0).astype(np.float64) * widths[number]
        before = np.cumsum(depth) - depth
        before -= np.repeat(before[firsts[steps[own] > 0]], steps[own][steps[own] > 0])
        weight = np.exp(-before) * -np.expm1(-depth)
        seen = np.flatnonzero((weight > _LEAST) & (np.exp(-before) > _OPAQUE))
        for part in np.array_split(seen, max(1, -(-len(seen) // points))):
            if part.size:
                shown = color(places[part], ways[ray[part]].astype(np.float32))
                np.add.at(rgb, ray[part], weight[part, None] * shown)
        np.subtract.at(left, ray, weight)
    left = np.clip(left, 0, 1)
    behind: Any = np.asarray(background)
    return rgb + left[:, None] * behind, left
