"""Bakes a trained nerfstudio scene.

    python -m mipvog_bake.nerfstudio outputs/chair/nerfacto/2026-01-01/config.yml -o chair.mipvog

The box is the scene's own, or `--bounds`. A contracted scene is baked whole, in boxes around the
cube of half size 1, unless there are `--bounds`. Options of `mipvog-bake bake` may follow.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Optional

import numpy as np

from ._bake import bake
from ._error import Error
from ._model import from_model

# Nodes along the longest axis.
_RESOLUTION = 256


def functions(field: Any) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """The density and colour functions of a `nerfstudio.fields.base_field.Field` for `from_model`,
    with tensors on the field's device."""
    import torch
    from nerfstudio.cameras.rays import Frustums, RaySamples
    from nerfstudio.field_components.field_heads import FieldHeadNames

    def samples(positions: Any, directions: Any) -> Any:
        # Points are frustums without length.
        zero = torch.zeros_like(positions[:, :1])
        one = torch.ones_like(zero)
        frustums = Frustums(positions, directions, starts=zero, ends=zero, pixel_area=one)
        cameras = torch.zeros_like(zero, dtype=torch.long)
        return RaySamples(frustums=frustums, camera_indices=cameras)

    def density(positions: Any) -> Any:
        down = torch.zeros_like(positions)
        down[:, 2] = -1
        return field.get_density(samples(positions, down))[0]

    def color(positions: Any, directions: Any) -> Any:
        return field(samples(positions, directions))[FieldHeadNames.RGB]

    return density, color


def space(
    field: Any, scene_box: Any, bounds: Optional[Sequence[float]] = None
) -> tuple[list[list[float]], Optional[Callable[..., Any]]]:
    """The box to bake and its surroundings: the given box without surroundings, or the box of the
    scene. For a contracted scene, the uncontracted cube and the contraction."""
    distortion = getattr(field, "spatial_distortion", None)
    if bounds is None and distortion is not None:
        return [[-1.0] * 3, [1.0] * 3], distortion
    corners = list(bounds) if bounds is not None else scene_box.aabb.reshape(-1).tolist()
    return [[float(value) for value in corners[:3]], [float(value) for value in corners[3:]]], None


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Runs the command and returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m mipvog_bake.nerfstudio",
        description="Bakes a trained nerfstudio scene; options of mipvog-bake bake may follow.",
    )
    parser.add_argument("config", type=Path, help="the config.yml of a training")
    parser.add_argument("-o", "--output", required=True, help="the container to write")
    parser.add_argument("--resolution", type=int, default=_RESOLUTION, help="[default: 256]")
    parser.add_argument(
        "--bounds",
        type=float,
        nargs=6,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="the box to bake, in the units of training [default: all of the scene]",
    )
    parser.add_argument("--sh-degree", type=int, default=2, help="0 to 3 [default: 2]")
    parser.add_argument("--device", help="of torch, such as cpu or cuda:1 [default: the model's]")
    parser.add_argument("--max-memory", type=int, help="bytes, beside the model's own")
    known, others = parser.parse_known_args(arguments)
    try:
        report = _bake_config(known, _options(others))
    except Error as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    psnr = report["view"]["held_out_psnr"]
    print(
        f"{known.output}: {report['output_bytes']} bytes, colours {psnr:.2f} dB along directions "
        "that no fit has seen"
    )
    return 0


def _bake_config(known: argparse.Namespace, options: dict[str, Any]) -> dict[str, Any]:
    if not known.config.is_file():
        name = str(known.config)
        raise Error(f"{name}: found no such file", "io", name, None, 5, "check the path")
    if Path(known.output).exists() and not options.get("force"):
        raise Error(
            f"{known.output}: the output exists already",
            kind="exists",
            file=str(known.output),
            exit_code=7,
            help="pass --force to replace it",
        )
    try:
        from nerfstudio.utils.eval_utils import eval_setup
    except ImportError as error:
        raise Error(
            f"found no nerfstudio ({error}), expected it to be installed",
            help="run this where ns-train runs",
        ) from error
    _, pipeline, _, _ = eval_setup(known.config)
    model = pipeline.model
    field = getattr(model, "field", None) or getattr(model, "field_fine", None)
    if field is None or not hasattr(field, "get_density"):
        raise Error(
            f"{known.config}: found a model {type(model).__name__} without a field of densities, "
            "expected a radiance field such as nerfacto",
            kind="unsupported",
            exit_code=4,
            help="methods of splats and of surfaces have none",
        )
    field.eval()
    if known.device is not None:
        field.to(known.device)
    density, color = functions(field)
    bounds, contraction = space(field, model.scene_box, known.bounds)
    sampled = from_model(
        density,
        color,
        bounds=bounds,
        contraction=contraction,
        resolution=known.resolution,
        sh_degree=known.sh_degree,
        device=next(field.parameters()).device,
        max_memory=known.max_memory,
        cameras=_cameras(pipeline),
        background=_background(model),
    )
    return bake(sampled, known.output, **{**_range(model), **options})


def _background(model: Any) -> Sequence[float]:
    """The background colour of the training. Black if the training used the last sample's colour,
    which containers cannot store, or a random colour."""
    found = getattr(getattr(model, "renderer_rgb", None), "background_color", None)
    if isinstance(found, str):
        return (1.0, 1.0, 1.0) if found == "white" else (0.0, 0.0, 0.0)
    if found is None:
        return (1.0, 1.0, 1.0)
    numbers = found.tolist() if hasattr(found, "tolist") else list(found)
    return tuple(map(float, numbers))


def _range(model: Any) -> dict[str, float]:
    """The range in which the collider lets rays start: nearer samples were never trained."""
    near = getattr(getattr(model, "collider", None), "near_plane", None)
    return {} if near is None else {"near": float(near)}


def _cameras(pipeline: Any) -> Any:
    """The training cameras, if the run still has them: pinholes with their lenses."""
    dataset = getattr(getattr(pipeline, "datamanager", None), "train_dataset", None)
    cameras = getattr(dataset, "cameras", None)
    if cameras is None:
        return None
    matrices = cameras.camera_to_worlds.detach().cpu().numpy()
    kinds = getattr(cameras, "camera_type", None)
    # Number 1 are perspective cameras. Other lenses see more than a pyramid.
    if kinds is None or (kinds.detach().cpu().numpy() != 1).any():
        return matrices
    last = np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(matrices), 1, 4))
    names = {"fl_x": "fx", "fl_y": "fy", "cx": "cx", "cy": "cy", "w": "width", "h": "height"}
    lenses = {
        name: getattr(cameras, own).detach().cpu().numpy().reshape(-1).tolist()
        for name, own in names.items()
    }
    frames = [
        {"transform_matrix": matrix, **{name: values[number] for name, values in lenses.items()}}
        for number, matrix in enumerate(np.concatenate([matrices, last], axis=1).tolist())
    ]
    return {"frames": frames}


def _options(words: Sequence[str]) -> dict[str, Any]:
    """Parses `--name value`, `--name=value` and `--name` into keywords."""
    options: dict[str, Any] = {}
    left = list(words)
    while left:
        word = left.pop(0)
        if not word.startswith("--"):
            raise Error(f"found {word!r}, expected an option of mipvog-bake bake")
        name, equals, value = word[2:].partition("=")
        if not equals:
            is_flag = not left or left[0].startswith("--")
            options[name.replace("-", "_")] = True if is_flag else left.pop(0)
        else:
            options[name.replace("-", "_")] = value
    return options


if __name__ == "__main__":
    sys.exit(main())
