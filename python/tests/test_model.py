"""Models that are functions: a closed form, its own pictures, and the bounds on memory."""

import json
import tracemalloc

import numpy as np
import pytest
from scenes import camera, night, psnr

import mipvog_bake

BOX = ((-1, -1, -1), (1, 1, 1))
LIGHT = np.array([0.48, -0.6, 0.64])


def density(points):
    """A ball with a soft edge of two hundredths, in fog that fades to the faces of the box."""
    radius = np.linalg.norm(points, axis=1)
    ball = 60 / (1 + np.exp(np.clip((radius - 0.55) / 0.012, -40, 40)))
    fog = 0.3 * np.prod(np.clip((1 - np.abs(points)) / 0.2, 0, 1), axis=1)
    return ball + fog


def color(points, directions):
    """A gradient, and a glossy term around the mirrored light."""
    normal = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-6)
    mirrored = directions - 2 * (directions * normal).sum(axis=1, keepdims=True) * normal
    gloss = (0.5 + 0.5 * mirrored @ LIGHT) ** 3
    return np.clip(0.3 + 0.25 * points + 0.25 * gloss[:, None], 0, 1)


def marched(matrix, size, steps=400):
    """The closed form's own picture, over white."""
    focal = 0.5 * size / np.tan(0.5 * 0.6911112)
    rows, columns = np.mgrid[0:size, 0:size] + 0.5
    local = np.stack([(columns - size / 2) / focal, -(rows - size / 2) / focal], -1)
    local = np.concatenate([local, -np.ones((size, size, 1))], -1).reshape(-1, 3)
    ways = local @ matrix[:3, :3].T
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origin = matrix[:3, 3]
    with np.errstate(divide="ignore"):
        sides = np.stack([(-1 - origin) / ways, (1 - origin) / ways])
    near, far = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
    image = np.ones((size * size, 3))
    hit = np.flatnonzero(far > near)
    step = (far - near)[hit] / steps
    left, sums = np.ones(len(hit)), np.zeros((len(hit), 3))
    for number in range(steps):
        points = origin + (near[hit] + (number + 0.5) * step)[:, None] * ways[hit]
        alpha = 1 - np.exp(-density(points) * step)
        sums += (left * alpha)[:, None] * color(points, ways[hit])
        left *= 1 - alpha
    image[hit] = sums + left[:, None]
    return image.reshape(size, size, 3)


@night
def test_a_closed_form_looks_like_itself(tmp_path):
    field = mipvog_bake.from_model(density, color, bounds=BOX, resolution=128)
    report = mipvog_bake.bake(field, tmp_path / "ball.mipvog")
    baked = mipvog_bake.open(tmp_path / "ball.mipvog")
    figures = []
    for eye in ((0, -3.5, 0.8), (-2, 1.5, -2.2)):
        picture = baked.render(camera(eye), 144)
        figures.append(psnr(picture, marched(camera(eye), 144)))
    assert min(figures) >= 45
    assert field.report["view"]["held_out_psnr"] > 30
    view = report["view"]
    assert (view["kind"], view["degree"], view["fitted"]) == ("spherical_harmonics", 2, True)
    assert view["held_out_psnr"] == field.report["view"]["held_out_psnr"]


def test_only_occupied_cells_are_sampled():
    def small(points):
        return 50.0 * (np.linalg.norm(points - 0.4, axis=1) < 0.2)

    field = mipvog_bake.from_model(small, color, bounds=BOX, resolution=64, sh_degree=1)
    report = field.report
    assert report["blocks"] < 0.1 * report["blocks_total"]
    assert report["density_samples"] == 64**3 + 8 * 512 * report["blocks"]
    assert field.dimensions == (64, 64, 64) and field.model == "sampled"
    inside = field.sample([[0.4, 0.4, 0.4], [-0.4, 0, 0]])
    assert inside["density"].tolist() == [50, 0]


@night
def test_memory_is_bounded_and_refused_where_it_is_too_little(tmp_path):
    bound = 96 << 20
    tracemalloc.start()
    field = mipvog_bake.from_model(
        density, color, bounds=((-0.6,) * 3, (0.6,) * 3), resolution=72, max_memory=bound
    )
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert field.report["bytes"] <= bound and peak <= bound
    with pytest.raises(mipvog_bake.Error, match="max_memory=") as raised:
        mipvog_bake.from_model(density, color, bounds=BOX, resolution=72, max_memory=30 << 20)
    assert (raised.value.kind, raised.value.exit_code) == ("too_little_memory", 6)
    # The bound changes no sample.
    other = mipvog_bake.from_model(density, color, bounds=((-0.6,) * 3, (0.6,) * 3), resolution=72)
    for name, one in (("a", field), ("b", other)):
        mipvog_bake.bake(one, tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_cameras_decide_the_directions_of_the_fit(tmp_path):
    eyes = [(3 * np.cos(a), 3 * np.sin(a), 1.5) for a in np.linspace(0, 6, 24)]
    frames = [{"transform_matrix": camera(eye).tolist()} for eye in eyes]
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))
    upwards = []

    def asked(points, directions):
        upwards.append(directions[:, 2] > 0)
        return color(points, directions)

    def share_of_upward_directions(cameras):
        upwards.clear()
        field = mipvog_bake.from_model(density, asked, bounds=BOX, resolution=16, cameras=cameras)
        assert field.report["view"]["held_out_psnr"] > 30
        return np.concatenate(upwards).mean()

    around = share_of_upward_directions(None)
    assert 0.4 < around < 0.6
    # All cameras are above and look down. Nodes that few of them see are asked for all around.
    for cameras in (path, np.array(eyes), np.array([camera(eye) for eye in eyes])):
        assert share_of_upward_directions(cameras) < around - 0.1


def test_matter_between_the_samples_of_voxels_is_no_matter():
    def wall(points):
        return np.where(np.abs(points[:, 0]) < 0.01, 500.0, 0.0)

    with pytest.raises(mipvog_bake.Error, match="found no matter"):
        mipvog_bake.from_model(wall, color, bounds=BOX, resolution=33)


def test_functions_that_fail(tmp_path):
    def raises(points, directions):
        raise LookupError("my own fault")

    options = {"bounds": BOX, "resolution": 12}
    with pytest.raises(LookupError, match="my own fault"):
        mipvog_bake.from_model(density, raises, **options)
    cases = [
        (lambda p: p, color, "density: found shape .*expected shape"),
        (lambda p: np.full(len(p), np.nan), color, "density: found .* not finite"),
        (lambda p: ["a"] * len(p), color, "density: found dtype"),
        (lambda p: np.zeros(len(p)), color, "found no matter"),
        (density, lambda p, d: p[:, :2], "color: found shape"),
        (None, color, "density: found NoneType, expected a function"),
    ]
    for one, other, match in cases:
        with pytest.raises(mipvog_bake.Error, match=match):
            mipvog_bake.from_model(one, other, **options)
    bad = [
        {"bounds": (0, 1)},
        {"bounds": ((1, 1, 1), (0, 0, 0))},
        {"resolution": 1},
        {"sh_degree": 4},
        {"background": (2, 0, 0)},
        {"max_memory": -1},
        {"cameras": np.zeros((4, 2))},
        {"cameras": tmp_path / "none.json"},
    ]
    for change in bad:
        (name,) = change
        with pytest.raises(mipvog_bake.Error, match=name if name != "cameras" else "none|cameras"):
            mipvog_bake.from_model(density, color, **(options | change))
