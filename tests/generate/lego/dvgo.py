"""Trains DirectVoxGO (sunset1995/DirectVoxGO at 341e1fc) on the small pictures of "lego".

    python dvgo.py SOURCES PICTURES OUTPUT.tar [bounded|residual|unbounded]

Its own code runs, but for the CUDA parts (`dvgo_parts.py`) and mmcv's settings. The optimizer's
state is left out of OUTPUT.tar. Needs PyTorch 1.13, scipy, imageio, opencv-python and einops.
"""

import os
import runpy
import sys
from pathlib import Path

import dvgo_parts as parts
import rays

# Changes to the program's `configs/default.py`.
SMALL = {
    "coarse_train": {"N_iters": 600, "N_rand": 1024},
    "fine_train": {"N_iters": 1200, "N_rand": 1024, "pg_scale": [200, 400]},
    "coarse_model_and_render": {"num_voxels": 27000, "num_voxels_base": 27000},
    "fine_model_and_render": {
        "num_voxels": 8500,
        "num_voxels_base": 8500,
        "rgbnet_dim": 5,
        "rgbnet_width": 32,
    },
}
KINDS = {
    "bounded": {},
    "residual": {"fine_model_and_render": {"rgbnet_dim": 6, "rgbnet_direct": False}},
    # As `configs/nerf_unbounded/nerf_unbounded_default.py`, with a sky of matter.
    "unbounded": {
        "data": {"unbounded_inward": True, "rand_bkgd": True},
        "coarse_train": {"N_iters": 0},
        "fine_train": {
            "ray_sampler": "flatten",
            "weight_nearclip": 1.0,
            "pg_scale": [200, 400, 600],
            "tv_before": 900,
            "tv_dense_before": 900,
            "weight_tv_density": 1e-6,
            "weight_tv_k0": 1e-7,
        },
        "fine_model_and_render": {"alpha_init": 1e-4, "fast_color_thres": {0: 5e-6, 600: 1e-4}},
    },
}


class Settings(dict):
    __getattr__ = dict.__getitem__

    def __deepcopy__(self, memo):
        return Settings({key: value for key, value in self.items()})

    def dump(self, path):
        Path(path).write_text(repr(self))


def settings(pictures, out, kind):
    found = runpy.run_path("configs/default.py")
    found = {key: value for key, value in found.items() if not key.startswith("__")}
    found["data"].update(datadir=str(pictures), dataset_type="blender", white_bkgd=True)
    found.update(basedir=str(out.parent / "log"), expname=out.stem)
    for changes in (SMALL, KINDS[kind]):
        for part, values in changes.items():
            found[part].update(values)
    whole = {key: Settings(part) if isinstance(part, dict) else part for key, part in found.items()}
    return Settings(whole)


def main():
    sources, pictures, out, kind = sys.argv[1:]
    pictures, out = Path(pictures).resolve(), Path(out).resolve()
    os.chdir(sources)
    sys.path.insert(0, os.getcwd())
    config = settings(pictures, out, kind)
    reader = type("Config", (), {"fromfile": staticmethod(lambda _: config)})
    parts.put_in("mmcv", Config=reader)
    parts.put_in("torch_scatter", segment_coo=parts.segment_coo, scatter_add=None)
    parts.put_in("torch_efficient_distloss", flatten_eff_distloss=None)
    import torch.utils.cpp_extension

    torch.utils.cpp_extension.load = lambda **_: parts.PARTS
    from lib import dcvgo, dvgo, load_data, utils

    plain = load_data.load_data
    load_data.load_data = lambda data: {**plain(data), "near_clip": 0.5}
    sys.argv = ["run.py", "--config", "none", "--no_reload", "--i_print", "100"]
    runpy.run_path("run.py", run_name="__main__")

    saved = torch.load(out.parent / "log" / out.stem / "fine_last.tar")
    del saved["optimizer_state_dict"]
    if "mask_cache_path" in saved["model_kwargs"]:
        saved["model_kwargs"]["mask_cache_path"] = None
    torch.save(saved, out)
    model = utils.load_model(
        dcvgo.DirectContractedVoxGO if kind == "unbounded" else dvgo.DirectVoxGO, out
    )
    origins, directions = rays.chosen(pictures)
    lines = torch.tensor(origins), torch.tensor(directions)
    with torch.no_grad():
        seen = model(*lines, lines[1], near=2.0, far=6.0, bg=1, stepsize=0.5)
    # The program adds the background last.
    white, left = seen["rgb_marched"].numpy(), seen["alphainv_last"].numpy()
    path = out.with_suffix(".rays.safetensors")
    rays.write(path, origins, directions, rgb=white, black=white - left[:, None])


main()
