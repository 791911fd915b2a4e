"""What a world around an object costs, and whether the faces of its boxes are seen.

    python3 benches/worlds.py [NODES]

Needs the Python package. The scene is an object of NODES nodes along an edge (default 129) in six
boxes of ground and sky. It is baked with its surroundings and without them, and seen from within:

* time and memory of both bakes, and the share of the file that tables take;
* PSNR from the unbaked scene at full size, 1/4 and 1/8;
* the mean difference of neighbouring pixels on the ground across faces, baked over unbaked;
* the largest second difference of the PSNR of a flight from the middle through all boxes.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import mipvog_bake
import numpy as np

BOXES = 7
GROUND = -0.55
SIZE = 200
# Frames of a flight, and views of each.
FRAMES, SHIFTS = 60, 8


def scene(at):
    """Signed distance, above 0 in free space, and colour at positions `[n, 3]`."""
    x, y, z = at.T
    radius = np.linalg.norm(at, axis=1)
    waves = np.stack([np.sin(9 * x), np.sin(11 * y), np.sin(7 * z + x)])
    ball = np.linalg.norm(at - [0.1, 0, -0.05], axis=1) - 0.42 - 0.03 * waves.prod(axis=0)
    length = np.maximum(radius, 1)
    ground = z - GROUND
    sky = 0.8 * 2.0 ** (BOXES - 1) - radius
    root = length**0.5
    ripples = [np.sin(4 * x / root), np.cos(3 * y / root), np.sin(2 * x * y / length**2)]
    parts = np.stack([ball, ground, sky])
    nearest = parts.argmin(axis=0)
    colors = np.stack(
        [
            0.5 + 0.35 * waves,
            np.array([[0.45], [0.5], [0.3]]) + 0.2 * np.stack(ripples),
            np.stack([0.4 + 0.02 * z / length, 0.6 + 0.1 * z / length, 0.85 + 0 * z]),
        ]
    )
    return parts.min(axis=0), colors[nearest, :, np.arange(len(at))]


def arrays(nodes):
    """Sampled arrays: the world as nodes of each box hold it."""
    made = {"background": np.float32([1, 1, 1])}
    for level in range(BOXES):
        half = 2.0**level
        axis = np.linspace(-half, half, nodes)
        spacing = axis[1] - axis[0]
        density = np.zeros((nodes,) * 3, "f4")
        color = np.zeros((nodes,) * 3 + (3,), "f4")
        for number, x in enumerate(axis):
            y, z = np.meshgrid(axis, axis, indexing="ij")
            at = np.stack([np.full(y.size, x), y.ravel(), z.ravel()], -1)
            distance, seen = scene(at)
            share = np.clip(0.5 - distance / spacing, 0, 1)
            # Matter is thin: what lies deep inside is never seen.
            share[distance < -4 * spacing] = 0
            density[number] = (8 / spacing * share).reshape(nodes, nodes)
            color[number] = seen.reshape(nodes, nodes, 3)
        name = f"level{level}." if level else ""
        made |= {f"{name}density": density, f"{name}color": color}
        made[f"{name}aabb"] = np.float32([[-half] * 3, [half] * 3])
    return made


def bake(source, target, *more):
    """Seconds, and bytes of memory."""
    words = [sys.executable, "-m", "mipvog_bake", "bake", source, "-o", target, "--force", "-q"]
    start = time.perf_counter()
    child = subprocess.Popen([str(word) for word in [*words, *more]])
    _, status, usage = os.wait4(child.pid, 0)
    assert status == 0
    return time.perf_counter() - start, usage.ru_maxrss * 1024


def camera(eye, to):
    """Camera to world, looking from one place to another."""
    back = np.array(eye, float) - to
    back /= np.linalg.norm(back)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, eye], -1)
    return matrix


def psnr(a, b):
    return -10 * math.log10(max(float(((np.clip(a, 0, 1) - np.clip(b, 0, 1)) ** 2).mean()), 1e-20))


def shrunk(picture, by):
    side = len(picture) // by
    return picture[: side * by, : side * by].reshape(side, by, side, by, 3).mean(axis=(1, 3))


def on_ground(matrix, side):
    """Where the rays of pixels meet the ground; not finite where they do not."""
    focal = 0.5 * side / math.tan(0.5 * 0.6911112)
    rows, columns = np.mgrid[0:side, 0:side] + 0.5
    right, up = (columns - side / 2) / focal, (side / 2 - rows) / focal
    ways = np.stack([right, up, -np.ones_like(rows)], -1) @ matrix[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (GROUND - matrix[2, 3]) / ways[..., 2]
    return np.where((t > 0)[..., None], matrix[:3, 3] + t[..., None] * ways, np.nan)


def seams(pictures, matrix):
    """Mean differences of neighbouring pixels across faces of boxes, of each picture."""
    at = on_ground(matrix, SIZE)
    with np.errstate(invalid="ignore", divide="ignore"):
        numbers = np.ceil(np.log2(np.maximum(np.abs(at[..., :2]).max(axis=-1), 1)))
    crosses = np.isfinite(numbers[1:] + numbers[:-1]) & (numbers[1:] != numbers[:-1])
    # The object may stand before the ground.
    crosses &= np.abs(at[1:, :, :2]).max(axis=-1) > 0.9
    steps = [np.abs(picture[1:] - picture[:-1]).mean(axis=-1) for picture in pictures]
    return [step[crosses].mean() for step in steps]


def main():
    nodes = int(sys.argv[1]) if len(sys.argv) > 1 else 129
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        np.savez(folder / "world.npz", **arrays(nodes))
        costs = {}
        for name, more in (("inner box", ["--drop-background"]), ("world", [])):
            bake(folder / "world.npz", folder / "world.mipvog", *more)
            costs[name] = bake(folder / "world.npz", folder / "world.mipvog", *more)
            size = (folder / "world.mipvog").stat().st_size
            seconds, memory = costs[name]
            print(f"{name}: {seconds:.2f} s, {memory / 1e6:.0f} MB of memory, {size / 1e6:.2f} MB")
        (one, least), (all_, most) = costs.values()
        print(f"world over inner box: {all_ / one:.2f} x the time, {most / least:.2f} x the memory")
        words = [sys.executable, "-m", "mipvog_bake", "inspect", str(folder / "world.mipvog")]
        told = subprocess.run([*words, "--format", "json"], check=True, capture_output=True).stdout
        chunks = json.loads(told)["chunks"]
        tables = sum(chunk["bytes"] for chunk in chunks if chunk["kind"] == "TABL")
        print(f"tables: {100 * tables / size:.2f} % of the file")

        unbaked = mipvog_bake.open(folder / "world.npz")
        baked = mipvog_bake.open(folder / "world.mipvog")
        looks = [((-0.8, -0.7, 0.1), (0.2, 0.3, -0.2)), ((0.7, 0.8, -0.2), (6, 3, -0.6))]
        looks += [((-0.5, 0.6, 0.5), (-5, 8, 0.5)), ((0.8, -0.8, -0.3), (2.5, -4, -0.8))]
        found, ratios = {1: [], 4: [], 8: []}, []
        for eye, to in looks:
            matrix = camera(eye, to)
            reference = unbaked.render(matrix, SIZE)
            full = baked.render(matrix, SIZE)
            for scale in found:
                own = full if scale == 1 else baked.render(matrix, SIZE // scale)
                found[scale].append(psnr(own, shrunk(reference, scale)))
            ratios.append(seams([reference, full], matrix))
        for scale, values in found.items():
            print(f"PSNR at 1/{scale}:", *(f"{value:.1f}" for value in values))
        before, after = np.nanmean(ratios, axis=0)
        print(f"gradient across faces: {after / before:.4f} of the unbaked one")

        figures = []
        for far in np.geomspace(0.6, 0.45 * 2.0 ** (BOXES - 1), FRAMES):
            # The horizon stays in the picture. Views that differ by parts of a pixel make up for
            # the edges that one of them happens to meet.
            views_of = []
            for shift in range(SHIFTS):
                turn = 0.0108 * shift / SHIFTS
                matrix = camera((-far, -0.8 * far, 0.3 * far), (0, turn * far, 0.27 * far))
                reference = shrunk(unbaked.render(matrix, 4 * 64), 4)
                views = [field.render(matrix, 64) for field in (baked, unbaked)]
                views_of.append((*views, reference))
            own, plain, right = (np.stack(views) for views in zip(*views_of, strict=True))
            figures.append([psnr(own, right), psnr(plain, right)])
        for name, row in zip(("flight", "the same unbaked"), np.transpose(figures), strict=True):
            second = np.abs(np.diff(row, 2)).max()
            print(f"{name}: {row.min():.1f} to {row.max():.1f} dB, second difference {second:.2f}")


if __name__ == "__main__":
    main()
