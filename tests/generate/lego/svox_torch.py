"""Trains a PlenOctree with svox (sxyu/svox at dd61131) on the small pictures of "lego".

    python svox_torch.py SOURCES PICTURES OUTPUT.npz

svox holds the tree, renders it by its PyTorch path, refines it and saves it; the loop around is
this file's. That path adds the background along the wrong axis, which is mended in memory, and
only follows rays through boxes that are cubes.
"""

import sys
import time
from pathlib import Path

import torch

import rays
from svox2_torch import pixels

STEPS, BATCH, MOST = (150, 150, 150), 256, 600


def rendered(renderer, origins, directions, svox, brightness):
    renderer.background_brightness = brightness
    lines = svox.Rays(origins, directions.clone(), directions)
    return renderer(lines, cuda=False)


def main():
    sources, pictures, out = sys.argv[1:]
    text = (Path(sources) / "svox" / "renderer.py").read_text()
    wrong = "out_rgb += light_intensity * self.background_brightness"
    assert wrong in text, "the line to mend"
    sys.path.insert(0, sources)
    import svox
    import svox.renderer as module

    exec(
        compile(
            text.replace(wrong, wrong.replace("intensity *", "intensity[:, None] *")),
            module.__file__,
            "exec",
        ),
        vars(module),
    )
    torch.manual_seed(20210301)
    data = pixels(Path(pictures), 1.0)
    tree = svox.N3Tree(
        N=2,
        init_refine=3,
        radius=1.35,
        center=[0.0, 0.0, 0.2],
        depth_limit=5,
        data_format="SH4",
    )
    tree.data.data[..., -1] = 1.0
    renderer = module.VolumeRenderer(tree, step_size=1e-3)
    began, trains = time.time(), not Path(out).exists()
    for stage, steps in enumerate(STEPS if trains else ()):
        if stage:
            leaves = tree._all_leaves()
            depth = tree.parent_depth[leaves[:, 0], 1]
            dense = tree.data[tuple(leaves.T)][:, -1] * (depth == depth.max())
            dense = dense.topk(MOST).indices
            print("refines", dense.numel(), "of", len(leaves), flush=True)
            tree.refine(sel=tuple(leaves[dense].T))
            tree.shrink_to_fit()
        optimizer = torch.optim.Adam([tree.data], lr=0.1)
        rate = torch.ones(tree.data_dim)
        rate[-1] = 15.0
        for step in range(steps):
            batch = data[torch.randint(len(data), (BATCH,))]
            origins, directions, colors = batch.split(3, 1)
            seen = rendered(renderer, origins, directions, svox, 1.0)
            loss = (seen - colors).square().mean()
            loss.backward()
            before = tree.data.data.clone()
            optimizer.step()
            tree.data.data = before + (tree.data.data - before) * rate
            optimizer.zero_grad()
            if step % 50 == 0:
                print(stage, step, -10 * loss.log10().item(), time.time() - began, flush=True)
    if trains:
        tree.save(out, compress=True)

    # In double precision: a ray steps from leaf to leaf, and rounding skips some.
    tree = svox.N3Tree.load(out).double()
    # With volrend's step.
    renderer = module.VolumeRenderer(tree, step_size=1e-4)
    origins, directions = rays.chosen(pictures)
    lines = [torch.tensor(part).double() for part in (origins, directions)]
    with torch.no_grad():
        white, black = (rendered(renderer, *lines, svox, light).numpy() for light in (1.0, 0.0))
    path = Path(out).with_suffix(".rays.safetensors")
    rays.write(path, origins, directions, rgb=white, black=black)


main()
