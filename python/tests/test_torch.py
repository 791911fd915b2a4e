"""Models of torch: a vanilla NeRF of the example, and fields of nerfstudio's own package."""

import math
import subprocess
import sys
import types
import warnings
from pathlib import Path

import numpy as np
import pytest
from scenes import BOX, psnr

import mipvog_bake
from mipvog_bake import nerfstudio as command
from mipvog_bake._frusta import frusta_of

torch = pytest.importorskip("torch")
EXAMPLES = Path(__file__).parents[1] / "examples"


def wanted(positions):
    """The density and the colour that networks of the tests learn."""
    radius = positions.norm(dim=1, keepdim=True)
    return 12 * torch.sigmoid((0.6 - radius) * 30), 0.5 + 0.4 * positions


def checkpoint(path, hidden=48):
    """A small network as `nerf-pytorch` names it, trained for a moment."""
    torch.manual_seed(1)
    shapes = {
        "layer1": (hidden, 3 + 6 * 3),
        "layers_xyz.0": (hidden, hidden),
        "layers_xyz.1": (hidden, hidden),
        "fc_feat": (hidden, hidden),
        "fc_alpha": (1, hidden),
        "layers_dir.0": (hidden // 2, hidden + 3 + 6 * 2),
        "fc_rgb": (3, hidden // 2),
    }
    weights = {}
    for name, (rows, columns) in shapes.items():
        weights[f"{name}.weight"] = torch.randn(rows, columns) * math.sqrt(2 / columns)
        weights[f"{name}.bias"] = torch.zeros(rows)
    for weight in weights.values():
        weight.requires_grad = True
    torch.save({"model_coarse_state_dict": weights}, path)
    sys.path.insert(0, str(EXAMPLES))
    from nerf_pytorch import Nerf

    nerf = Nerf(path, "cpu")
    nerf.weights = weights
    optimizer = torch.optim.Adam(list(weights.values()), lr=5e-3)
    for _ in range(400):
        positions = 2 * torch.rand(1024, 3) - 1
        directions = torch.nn.functional.normalize(torch.randn(1024, 3), dim=1)
        density, color = wanted(positions)
        loss = ((nerf.density(positions)[:, None] - density) / 12).square().mean()
        loss = loss + (nerf.color(positions, directions) - color).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    weights = {name: weight.detach() for name, weight in weights.items()}
    torch.save({"model_coarse_state_dict": {}, "model_fine_state_dict": weights, "iter": 400}, path)
    return Nerf(path, "cpu")


def light(density, color, origins, directions, length, steps=256):
    """What a model's own rays see over white, on the way of a length."""
    left, sums = np.ones(len(origins)), np.zeros((len(origins), 3))
    for number in range(steps):
        positions = origins + (number + 0.5) * length / steps * directions
        inside = (np.abs(positions) < 1).all(axis=1, keepdims=True)
        rows = [torch.from_numpy(row.astype(np.float32)) for row in (positions, directions)]
        with torch.no_grad():
            alpha = density(rows[0]).reshape(-1, 1).numpy() * inside
            found = color(*rows).numpy()
        alpha = 1 - np.exp(-alpha * length / steps)
        sums += left[:, None] * alpha * found
        left *= 1 - alpha[:, 0]
    return sums + left[:, None]


def rays(count=600):
    """Rays from all around through the box."""
    random = np.random.default_rng(5)
    ways = random.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return random.uniform(-0.8, 0.8, size=(count, 3)) - 3 * ways, ways


def test_a_vanilla_nerf_is_baked_by_the_example(tmp_path):
    nerf = checkpoint(tmp_path / "checkpoint.ckpt")
    output = tmp_path / "nerf.mipvog"
    command = [sys.executable, EXAMPLES / "nerf_pytorch.py", tmp_path / "checkpoint.ckpt", output]
    options = ["--resolution", "48", "--device", "cpu", "--bounds", *map(str, sum(BOX, ()))]
    done = subprocess.run(command + options, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    origins, directions = rays()
    own = light(nerf.density, nerf.color, origins, directions, 6)
    found, _, _ = mipvog_bake.open(output).probe(origins, directions)
    assert psnr(found, own) > 32 and own.std() > 0.1


def test_tensors_and_arrays_give_the_same_samples():
    def density(positions):
        return wanted(positions)[0]

    def color(positions, directions):
        return wanted(positions)[1]

    def of_arrays(positions):
        return density(torch.from_numpy(positions)).numpy()

    options = {"bounds": BOX, "resolution": 16}
    # A function that takes tensors alone is found to, and a module says so itself.
    found = [
        mipvog_bake.from_model(density, color, device="cpu", **options),
        mipvog_bake.from_model(density, color, **options),
        mipvog_bake.from_model(
            of_arrays, lambda p, d: color(torch.from_numpy(p), None).numpy(), **options
        ),
    ]
    points = np.random.default_rng(2).uniform(-1, 1, (100, 3))
    values = [field.sample(points) for field in found]
    assert all(np.array_equal(one["density"], values[0]["density"]) for one in values)
    assert all(np.array_equal(one["color"], values[0]["color"]) for one in values)


def test_a_model_on_another_device_is_named():
    layer = torch.nn.Linear(3, 1).to("meta")
    with pytest.raises(mipvog_bake.Error, match="density: .* on cpu .*\n.*name a device") as raised:
        mipvog_bake.from_model(
            layer.forward, lambda p, d: p, bounds=BOX, resolution=8, device="cpu"
        )
    assert raised.value.kind == "device"
    with pytest.raises(mipvog_bake.Error, match="density: "):
        mipvog_bake.from_model(
            lambda p: p[:, 0], lambda p, d: p, bounds=BOX, resolution=8, device="cuda:7"
        )


def test_parameters_are_taken_by_their_values():
    density = torch.nn.Parameter(torch.linspace(0, 9, 64).reshape(4, 4, 4))
    diffuse = torch.zeros(3, 4, 4, 4, requires_grad=True)
    fields = [
        mipvog_bake.from_arrays(density, diffuse=diffuse, bounds=BOX),
        mipvog_bake.from_arrays(
            density.detach().numpy(), diffuse=diffuse.detach().numpy(), bounds=BOX
        ),
    ]
    points = np.random.default_rng(4).uniform(-1, 1, (50, 3))
    taken, wanted = (field.sample(points)["density"] for field in fields)
    assert np.array_equal(taken, wanted) and taken.any()


@pytest.fixture(scope="module")
def fields():
    """Fields of nerfstudio's own package, with small weights."""
    pytest.importorskip("nerfstudio")
    with warnings.catch_warnings():
        # Other people's packages warn of each other.
        warnings.simplefilter("ignore")
        from nerfstudio.field_components.encodings import NeRFEncoding
        from nerfstudio.field_components.spatial_distortions import SceneContraction
        from nerfstudio.fields.nerfacto_field import NerfactoField
        from nerfstudio.fields.vanilla_nerf_field import NeRFField

    torch.manual_seed(3)
    small = {"num_levels": 4, "max_res": 16, "base_res": 4, "log2_hashmap_size": 12}
    nerfacto = NerfactoField(
        torch.tensor(BOX, dtype=torch.float32),
        num_images=3,
        implementation="torch",
        spatial_distortion=SceneContraction(order=float("inf")),
        average_init_density=3.0,
        **small,
    )
    encodings = [NeRFEncoding(3, count, 0, count - 1, include_input=True) for count in (3, 2)]
    vanilla = NeRFField(*encodings, base_mlp_num_layers=3, base_mlp_layer_width=32)
    return {"nerfacto": nerfacto.eval(), "vanilla": vanilla.eval()}


def scene_box(half=1.0):
    return types.SimpleNamespace(aabb=torch.tensor([[-half] * 3, [half] * 3]))


@pytest.mark.parametrize("name", ["nerfacto", "vanilla"])
def test_a_field_of_nerfstudio_looks_like_itself(fields, name, tmp_path, monkeypatch, capsys):
    field = fields[name]
    cameras = types.SimpleNamespace(camera_to_worlds=torch.eye(4)[None, :3].repeat(3, 1, 1))
    dataset = types.SimpleNamespace(cameras=cameras)
    pipeline = types.SimpleNamespace(
        model=types.SimpleNamespace(field=field, scene_box=scene_box()),
        datamanager=types.SimpleNamespace(train_dataset=dataset),
    )
    # The loader of a training takes all of nerfstudio; the field is the package's own.
    loader = types.ModuleType("nerfstudio.utils.eval_utils")
    loader.eval_setup = lambda config: (None, pipeline, config, 0)
    monkeypatch.setitem(sys.modules, "nerfstudio.utils.eval_utils", loader)
    (tmp_path / "config.yml").write_text("a training")
    output = str(tmp_path / "scene.mipvog")
    words = [str(tmp_path / "config.yml"), "-o", output, "--resolution", "28", "--levels=1"]
    words += ["--bounds", "-1", "-1", "-1", "1", "1", "1"]
    assert command.main(words) == 0, capsys.readouterr().err
    assert "dB along directions" in capsys.readouterr().out
    assert command.main(words) == 7 and "--force" in capsys.readouterr().err
    origins, directions = rays(200)
    own = light(*command.functions(field), origins, directions, 6)
    found, _, _ = mipvog_bake.open(output).probe(origins, directions)
    print(psnr(found, own), own.std(), own.mean())
    assert psnr(found, own) > 30


def test_contracted_space_is_baked_whole(fields, tmp_path):
    field = fields["nerfacto"]
    bounds, contraction = command.space(field, scene_box(1.5))
    assert bounds == [[-1.0] * 3, [1.0] * 3]
    assert command.space(field, scene_box(), [-2, -1, -1, 1, 1, 1]) == (
        [[-2.0, -1.0, -1.0], [1.0, 1.0, 1.0]],
        None,
    )
    assert command.space(fields["vanilla"], scene_box(1.5)) == ([[-1.5] * 3, [1.5] * 3], None)
    density, color = command.functions(field)
    world = mipvog_bake.from_model(
        density,
        color,
        bounds=bounds,
        contraction=contraction,
        resolution=25,
        sh_degree=1,
        device="cpu",
    )
    # Nodes are 1/12 apart; from 8 to 16 half sides there is 1/16 of contracted space.
    assert world.report["boxes"] == 4
    mipvog_bake.bake(world, tmp_path / "world.mipvog")
    places = np.random.default_rng(2).uniform(-5, 5, size=(300, 3)).astype(np.float32)
    found = mipvog_bake.open(tmp_path / "world.mipvog").sample(places)["density"]
    with torch.no_grad():
        own = density(torch.from_numpy(places)).numpy().ravel()
    # A node is the mean of its voxel.
    assert np.median(np.abs(found - own) / own) < 0.1


# Its viewer's packages warn of their own names.
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_lenses_of_nerfstudio_s_cameras_are_passed_on():
    from nerfstudio.cameras.cameras import Cameras, CameraType

    def found(kind):
        poses = torch.eye(4)[None, :3].repeat(2, 1, 1)
        poses[1, :, 3] = torch.tensor([1.0, 2.0, 3.0])
        cameras = Cameras(poses, 50.0, 40.0, 30.0, 20.0, 64, 48, camera_type=kind)
        manager = types.SimpleNamespace(train_dataset=types.SimpleNamespace(cameras=cameras))
        return command._cameras(types.SimpleNamespace(datamanager=manager))

    frusta = frusta_of(found(CameraType.PERSPECTIVE))
    assert np.allclose(frusta.eyes, [[0, 0, 0], [1, 2, 3]])
    assert np.allclose(frusta.slopes, [[-30 / 50, 34 / 50, -28 / 40, 20 / 40]] * 2)
    assert frusta.see(np.array([[1.0, 2.0, -7.0], [1.0, 2.0, 9.0]]), 0.1).tolist() == [True, False]
    # A fisheye sees more than a pyramid: its place alone counts.
    assert found(CameraType.FISHEYE).shape == (2, 3, 4)
