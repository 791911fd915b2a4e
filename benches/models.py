"""Bakes models of other systems of full size: seconds, processor seconds and memory.

    python3 benches/models.py target/release/mipvog-bake [FOLDER]

Needs numpy. The files are made up in FOLDER, or a temporary one: Plenoxels of 512^3 links with 20
million voxels, TensoRF of 300^3 nodes, 1.5 million of them visible, with a network a sample, and
SVRaster with 8 million voxels of 1024^3.
The floor is the time that numpy needs to read the same file.
"""

import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/generate"))
import torch_files  # noqa: E402

SEED = np.random.default_rng(1)


def plenoxels(path, side=512, voxels=20_000_000):
    """A ball's shell of density above 0, inside of a thicker one of density below it."""
    axis = ((np.arange(side, dtype=np.float32) + 0.5) / side * 2 - 1) ** 2
    radius = np.sqrt(axis[:, None, None] + axis[None, :, None] + axis[None, None, :])
    # The nodes that are nearest to the surface.
    away = np.abs(radius - 0.7)
    widest = np.partition(away.ravel(), voxels)[voxels]
    kept = away < widest
    count = int(kept.sum())
    links = np.full(radius.shape, -1, np.int32)
    links[kept] = np.arange(count, dtype=np.int32)
    density = np.where(away[kept] < widest / 4, 60, -3).astype(np.float32)[:, None]
    colors = np.empty((count, 27), np.float16)
    for part in np.array_split(np.arange(count), 40):
        colors[part] = SEED.normal(0, 0.4, (len(part), 27))
    np.savez(
        path, radius=np.ones(3, np.float32), center=np.zeros(3, np.float32), links=links,
        density_data=density, sh_data=colors, basis_type=np.int64(1),
    )


def box(side, half):
    """1 within `half` of the middle, else 0."""
    return (np.abs(np.arange(side) - (side - 1) / 2) <= half * side / 2).astype(np.float32)


def smooth(*shape):
    """Values that neighbours share."""
    coarse = SEED.normal(0, 0.3, (*shape[:2], 12, 12)).astype(np.float32)
    at = [np.arange(size) * 12 // size for size in shape[2:]]
    return coarse[:, :, at[0]][:, :, :, at[1]]


def tensorf(path, side=300, density=16, color=48):
    """A hollow box, with colours by a network of 150 inputs."""
    state = {}
    for number in range(3):
        plane = np.zeros((1, density, side, side), np.float32)
        line = np.zeros((1, density, side, 1), np.float32)
        if number == 0:
            for component, (half, value) in enumerate([(0.7, 18.0), (0.655, -18.0)]):
                mask = box(side, half)
                plane[0, component] = value * mask[:, None] * mask[None, :]
                line[0, component, :, 0] = mask
        colors = smooth(1, color, side, 12)[:, :, :, :1]
        state |= {
            f"density_plane.{number}": plane, f"density_line.{number}": line,
            f"app_plane.{number}": smooth(1, color, side, side), f"app_line.{number}": colors,
        }
    state["basis_mat.weight"] = SEED.normal(0, 0.3, (27, 3 * color)).astype(np.float32)
    for layer, (out, width) in zip((0, 2, 4), ((128, 150), (128, 128), (3, 128))):
        state[f"renderModule.mlp.{layer}.weight"] = SEED.normal(0, 0.1, (out, width)).astype("f4")
        state[f"renderModule.mlp.{layer}.bias"] = np.zeros(out, np.float32)
    bounds = np.array([[-1.5] * 3, [1.5] * 3], np.float32)
    arguments = {
        "aabb": torch_files.Tensor(bounds), "gridSize": [side] * 3, "density_n_comp": [density] * 3,
        "appearance_n_comp": [color] * 3, "app_dim": 27, "density_shift": -10.0,
        "alphaMask_thres": 1e-4, "distance_scale": 25.0, "rayMarch_weight_thres": 1e-4,
        "fea2denseAct": "softplus", "near_far": [2.0, 6.0], "step_ratio": 0.5,
        "shadingMode": "MLP_Fea", "pos_pe": 6, "view_pe": 2, "fea_pe": 2, "featureC": 128,
    }
    tensors = {name: torch_files.Tensor(value) for name, value in state.items()}
    torch_files.OUT = str(path.parent)
    outer, inner = (box(side, half) for half in (0.72, 0.64))
    mask = [axis[:, None, None] * axis[:, None] * axis > 0 for axis in (outer, inner)]
    torch_files.save(path.name, {
        "kwargs": arguments, "state_dict": tensors, "alphaMask.shape": (1, 1, side, side, side),
        "alphaMask.mask": np.packbits((mask[0] & ~mask[1]).reshape(-1)),
        "alphaMask.aabb": torch_files.Tensor(bounds),
    })


def interleaved(x):
    """The bits of 16-bit numbers, three apart."""
    found = np.zeros(x.shape, np.int64)
    for bit in range(16):
        found |= ((x >> bit) & 1).astype(np.int64) << (3 * bit)
    return found


def svraster(path, side=1024, voxels=8_000_000):
    """A bumpy ball's shell of voxels of one size, in the order of a training: none."""
    half, radius = side / 2, 0.31 * side
    thick = voxels / (8 * np.pi * radius**2)

    def away(at):
        x, y, z = np.moveaxis(at - half, -1, 0)
        bumps = 0.01 * side * np.sin(x / 37) * np.sin(y / 41) * np.sin(z / 29)
        return radius - np.sqrt(x * x + y * y + z * z) - bumps

    cells = []
    for x in range(side):
        y, z = np.mgrid[0:side, 0:side].astype(np.float32) + 0.5
        plane = np.abs(away(np.stack([np.full_like(y, x + 0.5), y, z], -1))) < thick
        cells.append(np.stack([np.full(plane.sum(), x), *np.nonzero(plane)], -1).astype(np.int32))
    cells = np.concatenate(cells)[SEED.permutation(sum(map(len, cells)))]
    steps = np.int64([(side + 1) ** 2, side + 1, 1])
    eight = [np.int64([x, y, z]) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    corners = np.unique(np.concatenate([(cells + corner) @ steps for corner in eight]))
    corners = np.stack([corners // steps[0], corners // steps[1] % steps[1], corners % steps[1]], -1)
    # Opaque a few voxels below the surface, with the noise that training leaves.
    raw = np.clip(1.2 * away(corners.astype(np.float32)) - 1, -10, 4)
    raw += SEED.normal(0, 0.1, len(raw))
    level = int(np.log2(side))
    x, y, z = (interleaved(cells[:, axis]) for axis in range(3))
    shs = np.empty((len(cells), 15, 3), np.float32)
    for part in np.array_split(np.arange(len(cells)), 40):
        shs[part] = SEED.normal(0, 0.05, (len(part), 15, 3))
    torch_files.OUT = str(path.parent)
    arrays = {
        "scene_center": np.zeros(3, np.float32), "inside_extent": np.float32(2),
        "scene_extent": np.float32(2), "octpath": ((x << 2 | y << 1 | z) << 3 * (16 - level))[:, None],
        "octlevel": np.full((len(cells), 1), level, np.int8), "_shs": shs,
        "_geo_grid_pts": raw.astype(np.float32)[:, None],
        "_sh0": np.sin(12 * cells / side).astype(np.float32),
    }
    tensors = {name: torch_files.Tensor(array) for name, array in arrays.items()}
    torch_files.save(path.name, {"active_sh_degree": 3, "quantized": False} | tensors)


def read(path):
    """Seconds until the arrays of a file are in memory."""
    start = time.perf_counter()
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            for name in arrays.files:
                arrays[name]
    else:
        path.read_bytes()
    return time.perf_counter() - start


def apart(work, path):
    """Work in a process of its own: the memory of a parent counts as its child's."""
    with multiprocessing.get_context("fork").Pool(1) as pool:
        return pool.apply(work, (path,))


def bake(program, path, *options):
    output = path.with_suffix(".mipvog")
    start = time.perf_counter()
    command = [program, "bake", path, *options, "-o", output, "--quiet", "--force"]
    child = subprocess.Popen(list(map(str, command)))
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - start
    if status:
        sys.exit(f"{path.name} was not baked")
    floor = apart(read, path)
    print(
        f"{path.name}: {seconds:.1f} s, {usage.ru_utime + usage.ru_stime:.1f} s of processor time, "
        f"{seconds / floor:.1f} times a read by numpy, {usage.ru_maxrss / 2**20:.2f} GiB at most, "
        f"{path.stat().st_size / 1e6:.0f} MB to {output.stat().st_size / 1e6:.1f} MB"
    )


def main():
    program = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[2] if len(sys.argv) > 2 else temporary)
        for name, make, options in [
            ("plenoxels.npz", plenoxels, ["--memory", "2G"]),
            ("tensorf.th", tensorf, ["--view", "sh:2"]),
            ("svraster.pt", svraster, []),
        ]:
            path = folder / name
            if not path.exists():
                apart(make, path)
            bake(program, path, *options)


if __name__ == "__main__":
    main()
