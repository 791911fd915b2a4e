"""Trains torch-ngp (ashawkey/torch-ngp at b6e0804) on the small pictures of "lego".

    python torch_ngp.py SOURCES PICTURES OUTPUT.pth [whole]

Its own trainer runs as for its README's `-O --bound 1 --scale 0.8 --dt_gamma 0`, or, for `whole`,
by its defaults, where steps grow with the distance; on a processor and in single precision.
`torch_ngp_parts.c` stands in for the CUDA parts, and the table is small.
OUTPUT is the checkpoint that it calls the best, its archive compressed. Needs gcc, PyTorch 1.13.
"""

import ctypes
import subprocess
import sys
import tempfile
import types
import zipfile
from pathlib import Path

import numpy as np
import torch

import absent
import rays

absent.put_in("lpips", "matplotlib", "mcubes", "pandas", "rich", "tensorboardX", "torch_ema",
              "trimesh")
EPOCHS = 30
OPTIONS = dict(
    bg_radius=-1, clip_text="", color_space="srgb", cuda_ray=True,
    error_map=False, fp16=False, iters=20 * EPOCHS, lr=1e-2, max_ray_batch=4096, max_steps=1024,
    num_rays=96, num_steps=512, offset=[0, 0, 0], patch_size=1, preload=False, rand_pose=-1,
    update_extra_interval=50, upsample_steps=0,
)
KINDS = {
    "": {"bound": 1.0, "scale": 0.8, "dt_gamma": 0.0},
    "whole": {"bound": 2.0, "scale": 0.33, "dt_gamma": 1 / 128},
}


def compiled(source):
    out = Path(tempfile.mkdtemp()) / "parts.so"
    words = ["gcc", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-o", out, source, "-lm"]
    subprocess.run(list(map(str, words)), check=True)
    return ctypes.CDLL(str(out))


def at(tensor, offset=0):
    assert tensor.is_contiguous()
    return ctypes.c_void_p(tensor.data_ptr() + offset * tensor.element_size())


class Parts:
    """The functions of the three extensions."""

    def __init__(self, library):
        self.of = library

    def grid_encode_forward(self, inputs, table, offsets, outputs, count, axes, features, levels,
                            log2_ratio, base, *_):
        assert (axes, features) == (3, 2)
        self.of.grid(at(inputs), at(table), at(offsets), at(outputs), count, levels,
                     ctypes.c_float(log2_ratio), base, None)

    def grid_encode_backward(self, grad, inputs, table, offsets, into, count, axes, features,
                             levels, log2_ratio, base, *_):
        self.of.grid(at(inputs), at(table), at(offsets), at(grad), count, levels,
                     ctypes.c_float(log2_ratio), base, at(into))

    def sh_encode_forward(self, inputs, outputs, *_):
        x, y, z = inputs.T
        a, b, c, d = 1.0925484305920792, 0.5900435899266435, 0.4570457994644658, 0.4886025119029199
        one = torch.ones_like(x)
        outputs.copy_(torch.stack([
            0.28209479177387814 * one, -d * y, d * z, -d * x, a * x * y, -a * y * z,
            0.31539156525252005 * (3 * z * z - 1), -a * x * z, a / 2 * (x * x - y * y),
            b * y * (y * y - 3 * x * x), 2.890611442640554 * x * y * z, c * y * (1 - 5 * z * z),
            0.3731763325901154 * z * (5 * z * z - 3), c * x * (1 - 5 * z * z),
            1.445305721320277 * z * (x * x - y * y), b * x * (3 * y * y - x * x),
        ], -1))

    def near_far_from_aabb(self, origins, directions, box, count, least, nears, fars):
        self.of.near_far(at(origins), at(directions), at(box), count, ctypes.c_float(least),
                         at(nears), at(fars))

    def morton3D(self, cells, count, codes):
        self.of.to_morton(at(cells.contiguous()), at(codes), count)

    def morton3D_invert(self, codes, count, cells):
        self.of.of_morton(at(codes), at(cells), count)

    def packbits(self, grid, count, threshold, bits):
        full = (grid.flatten() > threshold).view(-1, 8)
        bits.copy_((full * (1 << torch.arange(8))).sum(1).to(torch.uint8))

    def march(self, origins, directions, ray, bits, bound, growth, steps, cubes, side, t, far, most,
              xyz, toward, delta, place):
        into = (None, None, None) if xyz is None else (
            at(xyz, 3 * place), at(toward, 3 * place), at(delta, 2 * place))
        number = ctypes.c_float
        return self.of.march(
            at(origins, 3 * ray), at(directions, 3 * ray), at(bits), number(bound), number(growth),
            steps, cubes, side, number(t), number(far), most, *into)

    def march_rays_train(self, origins, directions, bits, bound, growth, steps, count, cubes, side,
                         room, nears, fars, xyz, toward, delta, lines, counter, noises):
        place = 0
        least = 2 * 3**0.5 / steps
        longest = least * steps * 2 ** (cubes - 1) / side
        for ray in range(count):
            t = nears[ray].item()
            t += min(longest, max(least, t * growth)) * noises[ray].item()
            same = (origins, directions, ray, bits, bound, growth, steps, cubes, side, t,
                    fars[ray].item())
            found = self.march(*same, steps, None, None, None, 0)
            lines[ray] = torch.tensor([ray, place, found])
            if place + found <= room:
                self.march(*same, found, xyz, toward, delta, place)
            place += found
        counter += torch.tensor([place, count])

    def march_rays(self, alive, most, rays_alive, rays_t, origins, directions, bound, growth, steps,
                   cubes, side, bits, near, far, xyz, toward, delta, noises):
        for n in range(alive):
            ray = rays_alive[n].item()
            self.march(origins, directions, ray, bits, bound, growth, steps, cubes, side,
                       rays_t[ray].item(), far[ray].item(), most, xyz, toward, delta, n * most)

    def composite_rays_train_forward(self, sigmas, rgbs, delta, lines, room, count, stop, weights,
                                     depth, image, *back):
        for ray, place, found in lines.tolist():
            if found == 0 or place + found > room:
                if not back:
                    weights[ray], depth[ray], image[ray] = 0, 0, 0
                continue
            given = [None] * 4
            if back:
                to_weights, to_image, to_sigma, to_rgb = back
                given = [at(to_weights, ray), at(to_image, 3 * ray), at(to_sigma, place),
                         at(to_rgb, 3 * place)]
            self.of.composite(at(sigmas, place), at(rgbs, 3 * place), at(delta, 2 * place), found,
                              ctypes.c_float(stop), at(weights, ray), at(depth, ray),
                              at(image, 3 * ray), int(bool(back)), *given)

    def composite_rays_train_backward(self, to_weights, to_image, sigmas, rgbs, delta, lines,
                                      weights, image, room, count, stop, to_sigma, to_rgb):
        self.composite_rays_train_forward(sigmas, rgbs, delta, lines, room, count, stop, weights,
                                          weights, image, to_weights, to_image, to_sigma, to_rgb)

    def composite_rays(self, alive, most, stop, rays_alive, rays_t, sigmas, rgbs, delta, weights,
                       depth, image):
        for n in range(alive):
            ray = rays_alive[n].item()
            goes_on = self.of.add(at(sigmas, n * most), at(rgbs, 3 * n * most),
                                  at(delta, 2 * n * most), most, ctypes.c_float(stop),
                                  at(rays_t, ray), at(weights, ray), at(depth, ray),
                                  at(image, 3 * ray))
            if not goes_on:
                rays_alive[n] = -1


def main():
    sources, pictures, out, *kind = sys.argv[1:]
    parts = Parts(compiled(Path(__file__).with_name("torch_ngp_parts.c")))
    for name in ("_gridencoder", "_raymarching", "_shencoder"):
        sys.modules[name] = parts
    torch.Tensor.cuda = lambda self: self
    sys.path.insert(0, sources)
    from nerf import network, provider, utils

    plain = network.get_encoder
    network.get_encoder = lambda name, **words: plain(
        name, **words, **({"num_levels": 8, "log2_hashmap_size": 11} if name == "hashgrid" else {}))
    options = types.SimpleNamespace(path=pictures, **OPTIONS, **KINDS["".join(kind)])
    utils.seed_everything(0)
    model = network.NeRFNetwork(
        bound=options.bound, cuda_ray=True, density_scale=1, min_near=0.2, density_thresh=10)
    loader = provider.NeRFDataset(options, device="cpu", type="train").dataloader()
    trainer = utils.Trainer(
        "ngp", options, model, device="cpu", workspace=str(Path(out).with_suffix("")),
        optimizer=lambda model: torch.optim.Adam(
            model.get_params(options.lr), betas=(0.9, 0.99), eps=1e-15),
        criterion=torch.nn.MSELoss(reduction="none"),
        lr_scheduler=lambda o: torch.optim.lr_scheduler.LambdaLR(
            o, lambda step: 0.1 ** min(step / options.iters, 1)),
        scheduler_update_every_step=True, use_checkpoint="scratch", use_tensorboardX=False,
        eval_interval=10**6,
    )
    trainer.train(loader, None, EPOCHS)
    trainer.stats["results"].append(trainer.stats["loss"][-1])
    trainer.stats["checkpoints"] = []
    trainer.save_checkpoint(full=False, best=True)
    print("PSNR", -10 * np.log10(trainer.stats["loss"][-1]), "best", trainer.best_path)
    packed = zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9)
    with zipfile.ZipFile(trainer.best_path) as whole, packed as small:
        for name in whole.namelist():
            small.writestr(name, whole.read(name))

    model.load_state_dict(torch.load(trainer.best_path)["model"], strict=False)
    model.eval()
    origins, directions = rays.chosen(pictures)
    lines = [torch.tensor(np.ascontiguousarray(part[:, [1, 2, 0]]))[None]
             for part in (options.scale * origins, directions)]
    with torch.no_grad():
        white, black = (model.render(*lines, staged=True, bg_color=b, perturb=False,
                                     dt_gamma=options.dt_gamma, max_steps=1024)["image"][0].numpy()
                        for b in (1, 0))
    path = Path(out).with_suffix(".rays.safetensors")
    rays.write(path, origins, directions, rgb=white, black=black)


main()
