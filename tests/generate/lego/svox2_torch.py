"""Trains Plenoxels (sxyu/svox2 at ee80e2c) on the small pictures of "lego", on a processor.

    python svox2_torch.py SOURCES PICTURES OUTPUT.npz [LAYERS]

svox2's classes hold the grid, render it by their reference in PyTorch, refine it and save it; the
loop around them is this file's, with Adam. Cameras are scaled by 2/3, as svox2 does. LAYERS adds
background spheres. Beside OUTPUT.npz: its `args.json` and rays.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import torch

import absent
import rays

absent.put_in("matplotlib", "torchvision", "tensorboard", "lpips")

SCALE = 2 / 3
RESOLUTIONS, STEPS, BATCH = (16, 32), (150, 250), 512


def pixels(pictures, scale=SCALE):
    """Origins, directions and colours of all pixels, on white."""
    cameras = json.loads((pictures / "transforms_train.json").read_text())
    parts = []
    for frame in cameras["frames"]:
        image = imageio.imread(pictures / f"{frame['file_path']}.png") / 255.0
        color = image[..., :3] * image[..., 3:] + 1 - image[..., 3:]
        height, width = color.shape[:2]
        focal = 0.5 * width / np.tan(0.5 * cameras["camera_angle_x"])
        y, x = np.mgrid[:height, :width] + 0.5
        toward = np.stack([(x - width / 2) / focal, (height / 2 - y) / focal, -np.ones_like(x)], -1)
        pose = np.array(frame["transform_matrix"])
        directions = toward @ pose[:3, :3].T
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        origins = np.broadcast_to(scale * pose[:3, 3], directions.shape)
        parts.append(np.concatenate([origins, directions, color], -1).reshape(-1, 9))
    return torch.tensor(np.concatenate(parts), dtype=torch.float32)


def settings(sources, out):
    """What svox2's training writes beside the grid."""
    sys.path.insert(0, str(sources / "opt"))
    from util import config_util

    parser = argparse.ArgumentParser()
    config_util.define_common_args(parser)
    words = parser.parse_args(["lego"]).__dict__
    (out.parent / f"{out.stem}.args.json").write_text(json.dumps(words, indent=2))


def main():
    sources, pictures, out, *layers = sys.argv[1:]
    sources, pictures, out = Path(sources), Path(pictures), Path(out)
    sys.path.insert(0, str(sources))
    import svox2

    settings(sources, out)
    layers = int(layers[0]) if layers else 0
    torch.manual_seed(20200823)
    data = pixels(pictures)
    grid = svox2.SparseGrid(
        reso=RESOLUTIONS[0], radius=1.0, basis_dim=9, background_nlayers=layers, background_reso=16
    )
    grid.opt.step_size, grid.opt.sigma_thresh, grid.opt.near_clip = 0.5, 1e-8, 0.0
    grid.density_data.data[:] = 0.1 if layers else 1.0
    if layers:
        grid.background_data.data[..., -1] = 0.1
    began = time.time()
    for resolution, steps in zip(RESOLUTIONS, STEPS):
        if resolution != RESOLUTIONS[0]:
            grid.resample(resolution, sigma_thresh=2.0, dilate=0, max_elements=2700)
        groups = [{"params": grid.density_data, "lr": 2.0}, {"params": grid.sh_data, "lr": 0.03}]
        if layers:
            groups.append({"params": grid.background_data, "lr": 0.1})
        optimizer = torch.optim.Adam(groups, betas=(0.9, 0.99))
        for step in range(steps):
            batch = data[torch.randint(len(data), (BATCH,))]
            origins, directions, colors = batch.split(3, 1)
            seen = grid.volume_render(svox2.Rays(origins, directions), use_kernel=False)
            loss = (seen - colors).square().mean()
            # A little weight on all density keeps empty space empty.
            (loss + 1e-5 * torch.relu(grid.density_data).mean()).backward()
            optimizer.step()
            optimizer.zero_grad()
            if step % 50 == 0:
                print(resolution, step, -10 * loss.log10().item(), time.time() - began, flush=True)
    grid.save(str(out))

    # What the file holds: harmonics in half precision.
    grid = svox2.SparseGrid.load(str(out))
    grid.opt.step_size, grid.opt.sigma_thresh, grid.opt.near_clip = 0.5, 1e-8, 0.0
    origins, directions = rays.chosen(pictures)
    origins *= np.float32(SCALE)
    lines = svox2.Rays(torch.tensor(origins), torch.tensor(directions))
    found = []
    with torch.no_grad():
        for brightness in (1.0, 0.0):
            grid.opt.background_brightness = brightness
            found.append(grid.volume_render(lines, use_kernel=False).numpy())
    path = out.parent / f"{out.stem}.rays.safetensors"
    rays.write(path, origins, directions, rgb=found[0], black=found[1])


if __name__ == "__main__":
    main()
