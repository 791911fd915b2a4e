"""Trains methods of nerfstudio 1.1.5 on the small pictures of "lego", by its own trainer.

    python nerfstudio_runs.py nerfacto|tensorf PICTURES OUTPUT

OUTPUT becomes the folder of the run, without the optimizers' state; beside it are rays that the
model rendered, in the space of the training. Needs PyTorch with torchvision, and the packages of
`python/tests/nerfstudio.txt`, tyro, nerfacc and torchmetrics. The metric that is a trained network
(LPIPS) is left out, with its weights.
"""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import torch

import absent
import rays

ABSENT = """av comet_ml dill fpsample gdown gsplat h5py jupyterlab matplotlib mediapy multiprocess
 newrawpy open3d pathos plotly ppft pymeshlab pyngrok pyquaternion pytorch_msssim rawpy skimage
 sklearn splines tensordict tensorly timm trimesh wandb xatlas"""
absent.put_in(*ABSENT.split())
MODELS = {
    "nerfacto": {
        "implementation": "torch",
        "num_levels": 6,
        "max_res": 160,
        "log2_hashmap_size": 11,
        "hidden_dim": 16,
        "hidden_dim_color": 16,
        "appearance_embed_dim": 4,
        "num_proposal_samples_per_ray": (48, 32),
        "num_nerf_samples_per_ray": 24,
        "proposal_net_args_list": [
            {
                "hidden_dim": 8,
                "log2_hashmap_size": 10,
                "num_levels": 4,
                "max_res": most,
                "use_linear": False,
            }
            for most in (32, 64)
        ],
    },
    "tensorf": {
        "init_resolution": 20,
        "final_resolution": 40,
        "upsampling_iters": (300, 500, 700),
        "num_samples": 50,
        "num_uniform_samples": 80,
        "num_den_components": 4,
        "num_color_components": 6,
        "appearance_dim": 9,
    },
}
STEPS = 600


def layout(pictures, folder):
    """The pictures as nerfstudio's own parser takes them."""
    cameras = json.loads((pictures / "transforms_train.json").read_text())
    focal = 50 / np.tan(0.5 * cameras["camera_angle_x"])
    frames = [dict(f, file_path=f"{f['file_path']}.png") for f in cameras["frames"]]
    whole = {"w": 100, "h": 100, "fl_x": focal, "fl_y": focal, "cx": 50, "cy": 50, "frames": frames}
    shutil.copytree(pictures, folder, dirs_exist_ok=True)
    (folder / "transforms.json").write_text(json.dumps(whole))


def settings(method, data, out):
    """The method's own, but small, in one process, and with batches for a processor."""
    from nerfstudio.configs.method_configs import method_configs
    from nerfstudio.data.datamanagers.base_datamanager import VanillaDataManagerConfig

    config = method_configs[method]
    loader = VanillaDataManagerConfig(
        dataparser=config.pipeline.datamanager.dataparser,
        train_num_rays_per_batch=256,
        eval_num_rays_per_batch=64,
    )
    config.pipeline.datamanager, loader.data = loader, data
    for name, value in MODELS[method].items():
        assert hasattr(config.pipeline.model, name), name
        setattr(config.pipeline.model, name, value)
    config.machine.device_type, config.vis, config.max_num_iterations = "cpu", "tensorboard", STEPS
    config.data, config.output_dir, config.experiment_name = data, out.parent / "runs", "lego"
    config.timestamp = "run"
    never = 10**6
    config.steps_per_eval_batch = config.steps_per_eval_image = never
    config.steps_per_eval_all_images = never
    return config


def trained(config, out):
    config.print_to_terminal()
    config.save_config()
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    trainer.train()
    shutil.copytree(config.get_base_dir(), out, ignore=shutil.ignore_patterns("events*"))
    for path in out.glob("nerfstudio_models/*.ckpt"):
        saved = torch.load(path, map_location="cpu")
        saved["optimizers"] = {}
        torch.save(saved, path)


def model_of(config, out):
    """Loaded from the file, as for nerfstudio's evaluation: in training, weights are annealed."""
    pipeline = config.pipeline.setup(device="cpu", test_mode="inference")
    (path,) = out.glob("nerfstudio_models/*.ckpt")
    saved = torch.load(path, map_location="cpu")
    pipeline.load_pipeline(saved["pipeline"], saved["step"])
    return pipeline.model.eval()


def main():
    method, pictures, out = sys.argv[1], *map(Path, sys.argv[2:])
    import torchmetrics.image
    import torchmetrics.image.lpip as lpip

    lpip.LearnedPerceptualImagePatchSimilarity = lambda **_: None
    torchmetrics.image.LearnedPerceptualImagePatchSimilarity = lambda **_: None
    from nerfstudio.cameras.rays import RayBundle

    torch.manual_seed(42)
    np.random.seed(42)
    data = out.parent / f"{out.name}_data"
    layout(pictures, data)
    config = settings(method, data, out)
    if not out.exists():
        trained(config, out)
    model = model_of(config, out)
    moved = json.loads((out / "dataparser_transforms.json").read_text())
    turn = np.array(moved["transform"])
    origins, directions = rays.chosen(pictures)
    origins = (moved["scale"] * (origins @ turn[:, :3].T + turn[:, 3])).astype(np.float32)
    directions = directions @ turn[:, :3].T.astype(np.float32)
    shape = (20, 20)
    lines = [torch.tensor(part).reshape(*shape, 3) for part in (origins, directions)]
    first = torch.zeros((*shape, 1), dtype=torch.int64)
    bundle = RayBundle(*lines, torch.full((*shape, 1), 1e-4), first)
    with torch.no_grad():
        seen = model.get_outputs_for_camera_ray_bundle(bundle)
    path = out.parent / f"{out.name}.rays.safetensors"
    rays.write(path, origins, directions, rgb=seen["rgb"].reshape(400, 3).numpy())


main()
