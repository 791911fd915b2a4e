"""Models of all space: a ball in a garden under a sky, sampled in nested boxes."""

import json

import numpy as np
import pytest
from scenes import psnr

import mipvog_bake
from mipvog_bake._frusta import frusta_of

BOX = ((-1, -1, -1), (1, 1, 1))
SKY = 13.0


def density(points):
    """A ball, a ground, and a sky that nothing is seen through."""
    radius = np.linalg.norm(points, axis=1)
    ball = 40 / (1 + np.exp(np.clip((radius - 0.4) / 0.03, -40, 40)))
    ground = 20 / (1 + np.exp(np.clip((points[:, 2] + 0.7) / 0.05, -40, 40)))
    sky = 6 / (1 + np.exp(np.clip((SKY - radius) / 0.3, -40, 40)))
    return ball + ground + sky


def color(points, directions):
    """Waves that grow longer with the distance, and a gradient of the view."""
    radius = np.linalg.norm(points, axis=1, keepdims=True)
    waves = 0.5 + 0.3 * np.sin(2.5 * points / np.maximum(radius, 0.5))
    return np.clip(waves + 0.1 * directions, 0, 1)


def marched(origins, ways, reach=30.0):
    """The model's own colours, in steps that grow with the distance."""
    edges = np.concatenate([np.arange(0, 3, 0.004), np.geomspace(3, reach, 3000)])
    rgb, left = np.zeros((len(ways), 3)), np.ones(len(ways))
    for near, far in zip(edges[:-1], edges[1:], strict=True):
        points = origins + 0.5 * (near + far) * ways
        alpha = 1 - np.exp(-density(points) * (far - near))
        rgb += (left * alpha)[:, None] * color(points, ways)
        left *= 1 - alpha
    return rgb + left[:, None]


def rays():
    random = np.random.default_rng(7)
    ways = random.normal(size=(400, 3))
    origins = random.uniform(-0.3, 0.3, size=(400, 3)) + np.array([0.0, -0.75, 0.1])
    return origins, ways / np.linalg.norm(ways, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def world():
    return mipvog_bake.from_model(density, color, bounds=BOX, resolution=49, extent=16)


def test_a_world_looks_like_itself_from_inside(world, tmp_path):
    report = world.report
    assert (report["boxes"], report["blocks"] < report["blocks_total"]) == (5, True)
    assert report["picture_psnr"] > 33 and report["view"]["held_out_psnr"] > 30
    assert report["transmittance"] < 0.01
    origins, ways = rays()
    expected = marched(origins, ways)
    found, left, _ = world.probe(origins, ways)
    assert psnr(found, expected) > 33 and left.max() < 0.01
    written = mipvog_bake.bake(world, tmp_path / "world.mipvog")
    assert len(written["shells"]) == 4
    baked, left, _ = mipvog_bake.open(tmp_path / "world.mipvog").probe(origins, ways)
    assert psnr(baked, expected) > 32 and left.max() < 0.01
    # Without its surroundings the same rays end in white.
    inner = mipvog_bake.from_model(density, color, bounds=BOX, resolution=49)
    assert inner.report["boxes"] == 1
    assert psnr(inner.probe(origins, ways)[0], expected) < 15


def test_only_what_lies_outside_the_smaller_box_is_asked_for():
    asked = []

    def watched(points):
        asked.append(points)
        return density(points)

    field = mipvog_bake.from_model(watched, color, bounds=BOX, resolution=33, extent=2, sh_degree=0)
    assert field.report["boxes"] == 2
    first = next(at for at, points in enumerate(asked) if np.abs(points).max() > 1.01)
    # Nodes of the second box lie at eighths; samples of voxels lie beside them. Few points are
    # those of rays that judge the field.
    points = np.concatenate([points for points in asked[first:] if len(points) > 1000])
    scan = points[(points * 8 == np.rint(points * 8)).all(axis=1)]
    assert np.abs(scan).max(axis=1).min() >= 0.875
    assert len(scan) > 33**3 - 17**3


def test_a_contraction_tells_how_far_a_world_reaches():
    def contract(points):
        most = np.abs(points).max(axis=1, keepdims=True)
        far = np.maximum(most, 1)
        return np.where(most <= 1, points, (2 - 1 / far) * points / far)

    options = {"bounds": BOX, "resolution": 17, "sh_degree": 0}
    field = mipvog_bake.from_model(density, color, contraction=contract, **options)
    # Nodes are 1/8 apart, and so is what lies beyond 8 half sides: contracted space ends at 2.
    assert field.report["boxes"] == 4
    for contraction, words in ((lambda points: points, "contracts space"), (3, "a function")):
        with pytest.raises(mipvog_bake.Error, match=words):
            mipvog_bake.from_model(density, color, contraction=contraction, **options)
    for extent in (0.5, 0, np.inf, 2e6, "far"):
        with pytest.raises(mipvog_bake.Error, match="extent: found"):
            mipvog_bake.from_model(density, color, extent=extent, **options)
    with pytest.raises(mipvog_bake.Error, match="one of the two"):
        mipvog_bake.from_model(density, color, extent=2, contraction=contract, **options)


def test_a_box_without_matter_is_empty():
    def far(points):
        return 5.0 * (np.abs(points[:, 2] - 3.0) < 0.5)

    field = mipvog_bake.from_model(far, color, bounds=BOX, resolution=17, extent=4, sh_degree=0)
    found = field.sample([[0, 0, 0.3], [0, 0, 3.0]])
    assert found["density"][0] == 0 and found["density"][1] > 3
    with pytest.raises(mipvog_bake.Error, match="found no matter"):
        mipvog_bake.from_model(far, color, bounds=BOX, resolution=17, extent=2, sh_degree=0)


def looking(count, angle=0.6, turned=0.35):
    """Frames of cameras near the middle that look along x, more or less."""
    frames = []
    for number in range(count):
        around = turned * np.sin(2.4 * number)
        back = -np.array([np.cos(around), np.sin(around), 0.1 * np.cos(number)])
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3, :3] = np.stack([right, np.cross(back, right), back], axis=-1)
        matrix[:3, 3] = [-0.8, 0.1 * np.sin(number), 0.1]
        frames.append({"transform_matrix": matrix.tolist()})
    return {"camera_angle_x": angle, "w": 80, "h": 60, "frames": frames}


def test_what_no_camera_shows_is_not_sampled(world, tmp_path):
    cameras = looking(16)
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps(cameras))
    options = {"bounds": BOX, "resolution": 49, "extent": 16}
    seen = mipvog_bake.from_model(density, color, cameras=path, **options)
    assert seen.report["blocks_seen"] < 0.4 * seen.report["blocks_total"]
    assert world.report["blocks_seen"] == world.report["blocks_total"]
    for kind in ("density_samples", "color_samples"):
        assert seen.report[kind] < 0.5 * world.report[kind]
    assert seen.report["picture_psnr"] > 33
    # Rays of the cameras' pictures show what they show with all of the world.
    frusta = frusta_of(cameras)
    origins, ways = frusta.rays(300)
    assert frusta.see(origins + 4 * ways, 0.0).all()
    assert not frusta.see(origins - 4 * ways, 0.0).any()
    expected = marched(origins, ways)
    found, left, _ = seen.probe(origins, ways)
    whole, _, _ = world.probe(origins, ways)
    assert left.max() < 0.01
    assert psnr(found, expected) > psnr(whole, expected) - 0.5
    # A dictionary is the same as its file; places alone leave nothing out.
    again = mipvog_bake.from_model(density, color, cameras=cameras, **options)
    assert again.report["blocks"] == seen.report["blocks"]
    eyes = frusta.eyes
    places = mipvog_bake.from_model(density, color, cameras=eyes, **options)
    assert places.report["blocks_seen"] == places.report["blocks_total"]


def test_cameras_without_a_lens_are_refused():
    frames = [{"transform_matrix": np.eye(4).tolist()}]
    with pytest.raises(mipvog_bake.Error, match="camera_angle_x"):
        mipvog_bake.from_model(
            density, color, bounds=BOX, resolution=9, extent=4, cameras={"frames": frames}
        )
