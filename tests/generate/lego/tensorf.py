"""Trains TensoRF (apchenstu/TensoRF at 6a1e23b) on the small pictures of "lego", by its own code.

    python tensorf.py TENSORF_SOURCES PICTURES OUTPUT.th [OPTION...]

Needs PyTorch with torchvision, configargparse, imageio, plyfile, opencv-python and tensorboard.
OPTIONs are those of TensoRF's `train.py`. Rays are rendered by its renderer, on a processor.
"""

import shutil
import sys
import types
from pathlib import Path

import numpy as np
import torch

import rays

OPTIONS = """--dataset_name blender --downsample_train 8 --n_iters 1200 --batch_size 512
 --N_voxel_init 8000 --N_voxel_final 64000 --upsamp_list 300 --upsamp_list 600
 --update_AlphaMask_list 400 --update_AlphaMask_list 800 --N_vis 0
 --n_lamb_sigma 4 --n_lamb_sigma 4 --n_lamb_sigma 4 --n_lamb_sh 6 --n_lamb_sh 6 --n_lamb_sh 6
 --featureC 32 --fea2denseAct softplus --L1_weight_inital 8e-5 --L1_weight_rest 4e-5"""
NETWORK = "--shadingMode MLP_Fea --view_pe 2 --fea_pe 2"


def stand_in(name, **contents):
    """A module that the program imports, but of which it needs no more than this."""
    module = types.ModuleType(name)
    vars(module).update(contents)
    sys.modules[name] = module


def meshgrid(height, width, normalized_coordinates):
    across, down = torch.meshgrid(torch.arange(width), torch.arange(height), indexing="xy")
    return torch.stack([across, down], -1)[None].float()


def main():
    sources, pictures, out, *options = sys.argv[1:]
    pictures, out = Path(pictures).resolve(), Path(out).resolve()
    stand_in("kornia", create_meshgrid=meshgrid)
    stand_in("skimage", measure=None)
    stand_in("skimage.measure")
    sys.path.insert(0, sources)
    import train

    words = OPTIONS.split() + (options or NETWORK.split())
    words += [
        "--datadir",
        str(pictures),
        "--expname",
        out.stem,
        "--basedir",
        str(out.parent / "log"),
    ]
    torch.manual_seed(20211202)
    np.random.seed(20211202)
    train.args = train.config_parser(words)
    train.reconstruction(train.args)
    shutil.copy(out.parent / "log" / out.stem / f"{out.stem}.th", out)

    saved = torch.load(out, map_location="cpu")
    model = getattr(train, train.args.model_name)(**{**saved["kwargs"], "device": "cpu"})
    model.load(saved)
    origins, directions = rays.chosen(pictures)
    lines = torch.tensor(np.concatenate([origins, directions], 1))
    with torch.no_grad():
        white, black = (
            train.renderer(lines, model, 4096, white_bg=white, device="cpu")[0].numpy()
            for white in (True, False)
        )
    rays.write(out.with_suffix(".rays.safetensors"), origins, directions, rgb=white, black=black)


main()
