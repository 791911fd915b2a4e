"""Open fields: shapes, values and pictures."""

import pickle
import shutil
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from scenes import BOX, ball, camera, sampled_arrays

import mipvog_bake

TINY = Path(__file__).parents[2] / "fixtures/trained/tiny/fine_last.tar"


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    path = tmp_path_factory.mktemp("baked") / "ball.mipvog"
    mipvog_bake.bake(sampled_arrays(), path)
    return mipvog_bake.open(path)


def test_a_field_states_what_is_in_it(baked):
    assert baked.dimensions == (24, 24, 24)
    assert baked.bounds.min == (-1, -1, -1) and np.array(baked.bounds).shape == (2, 3)
    assert [level["level"] for level in baked.levels] == list(range(len(baked.levels)))
    assert baked.levels[0]["dimensions"] == [24, 24, 24]
    assert baked.metadata["background"] == [1, 1, 1] and baked.model == "baked"
    assert "24 x 24 x 24 nodes" in repr(baked) and "ball.mipvog" in repr(baked)


def test_unpack_gives_the_levels_asked_for(baked):
    values = baked.unpack([1])
    names = {"level1.density", "level1.diffuse", "level1.anisotropy", "level1.occupied"}
    assert set(values) == names
    assert values["level1.density"].shape == tuple(baked.levels[1]["dimensions"])
    assert baked.unpack(1).keys() == values.keys()
    with pytest.raises(mipvog_bake.Error, match="levels"):
        baked.unpack([99])


def test_rays_and_points_agree_with_the_scene(baked):
    rgb, left, depth = baked.probe([[0, 0, 4], [3, 3, 4]], [[0, 0, -2], [0, 0, -1]])
    assert rgb.shape == (2, 3) and left.shape == depth.shape == (2,)
    assert left[0] < 1e-3 and abs(depth[0] - 3.3) < 0.1
    assert left[1] == 1 and np.allclose(rgb[1], 1)
    values = baked.sample([[0, 0, 0], [0.95, 0.95, 0.95]])
    assert values["density"][0] == pytest.approx(40, rel=0.02) and values["density"][1] == 0
    assert np.allclose(values["color"][0], 0.5, atol=0.05)
    coarse = baked.probe([[0, 0, 4]], [[0, 0, -1]], level=1)
    assert abs(coarse[2][0] - depth[0]) < 0.3


def test_cameras_of_every_form_see_the_same(baked, tmp_path):
    matrix = camera((0, -4, 0.5))
    frame = {"transform_matrix": matrix, "camera_angle_x": 0.6911112}
    pictures = [baked.render(one, 24) for one in (matrix, matrix[:3], frame)]
    path = tmp_path / "transforms.json"
    frames = [{"file_path": "./r_0", "transform_matrix": matrix.tolist()}]
    path.write_text(__import__("json").dumps({"camera_angle_x": 0.6911112, "frames": frames}))
    pictures += [baked.render(path, 24), baked.render(path, 24, frame="r_0")]
    assert all(np.array_equal(picture, pictures[0]) for picture in pictures)
    assert pictures[0].std() > 0.05


def test_notebooks_get_a_png(baked):
    png = baked._repr_png_()
    assert png[:8] == b"\x89PNG\r\n\x1a\n" and struct.unpack(">II", png[16:24]) == (320, 320)


def test_unbaked_fields_render_like_their_containers(tmp_path):
    density, diffuse = ball()
    field = mipvog_bake.from_arrays(density, diffuse=diffuse, bounds=BOX)
    assert field.dimensions == (24, 24, 24) and field.model == "dvgo"
    mipvog_bake.bake(field, tmp_path / "ball.mipvog", bits=16)
    # A pixel of 64 is half a node wide, so the container's picture is of level 0 alone.
    picture = field.render(camera((1, -4, 1)), 64)
    other = mipvog_bake.open(tmp_path / "ball.mipvog").render(camera((1, -4, 1)), 64)
    assert np.abs(picture - other).max() < 0.01
    with pytest.raises(mipvog_bake.Error, match="bake it first"):
        field.unpack()


def test_a_network_makes_colours_that_depend_on_the_view(tmp_path):
    density, diffuse = ball()
    random = np.random.default_rng(3)
    features = random.normal(size=(4, *density.shape)).astype(np.float32)
    width = 4 + 3 + 3 * 2 * 4
    network = [
        (random.normal(size=(16, width)), np.zeros(16)),
        (random.normal(size=(3, 16)), np.zeros(3)),
    ]
    field = mipvog_bake.from_arrays(
        density, diffuse=diffuse, features=features, network=network, bounds=BOX
    )
    report = mipvog_bake.bake(field, tmp_path / "ball.mipvog")
    assert report["view"]["kind"] == "network"
    values = mipvog_bake.open(tmp_path / "ball.mipvog").unpack(0)
    assert values["level0.features"].shape == features.shape
    assert np.allclose(values["mlp.0.weight"], network[0][0].astype(np.float32))


def test_borrowed_and_converted_arrays_bake_to_the_same_bytes(tmp_path):
    density, diffuse = ball()
    forms = {
        "borrowed": (density, diffuse),
        "double": (density.astype(np.float64), diffuse.astype(np.float64)),
        "fortran": (np.asfortranarray(density), np.asfortranarray(diffuse)),
        "sliced": (np.repeat(density, 2, axis=2)[:, :, ::2], diffuse),
        "big": (density.astype(">f4"), diffuse.astype(">f4")),
    }
    found = set()
    for name, (one, other) in forms.items():
        field = mipvog_bake.from_arrays(one, diffuse=other, bounds=BOX)
        mipvog_bake.bake(field, tmp_path / f"{name}.mipvog")
        found.add((tmp_path / f"{name}.mipvog").read_bytes())
    assert len(found) == 1


def test_errors_survive_pickling():
    error = mipvog_bake.Error("found a, expected b", "malformed", "f", "p", 3, "mend it")
    copy = pickle.loads(pickle.dumps(error))
    assert (copy.kind, copy.file, copy.place, copy.exit_code) == ("malformed", "f", "p", 3)
    assert str(copy) == "found a, expected b\nhelp: mend it"


def test_settings_of_an_unbaked_field_are_those_of_the_program(tmp_path):
    trained = tmp_path / "fine_last.tar"
    shutil.copy(TINY, trained)

    def opened(**options):
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            field = mipvog_bake.open(trained, **options)
        return field, " ".join(str(warning.message) for warning in found)

    field, assumed = opened()
    assert "step length" in assumed and "coarse checkpoint" in assumed
    assert field.metadata["march"]["near"] == 0
    (tmp_path / "scene.toml").write_text("stepsize = 0.25\nnear = 0.5\n", encoding="utf-8")
    field, assumed = opened()
    assert "step length" not in assumed
    assert field.metadata["march"]["near"] == 0.5
    assert field.metadata["march"]["stepsize"] == 0.25
    field, _ = opened(near=1, background="black", mlp="none")
    assert field.metadata["march"]["near"] == 1
    assert field.metadata["background"] == [0, 0, 0]
    # A bake of the field has what it was opened with, and options of its own.
    report = mipvog_bake.bake(field, tmp_path / "a.mipvog", near=2)
    found = {setting["name"]: setting["value"] for setting in report["settings"]}
    assert found["near"] == 2 and found["background"] == [0, 0, 0]
    baked = mipvog_bake.open(tmp_path / "a.mipvog", background=(1, 0, 0))
    assert np.allclose(baked.probe([[9, 9, 9]], [[1, 0, 0]])[0], [1, 0, 0])
    for options, words in [
        ({"mlp": "none"}, "belong to trained inputs"),
        ({"near": -1}, "near: found -1"),
        ({"nothing": 1}, "nothing"),
        ({"field": 1}, "glTF asset"),
    ]:
        with pytest.raises(mipvog_bake.Error, match=words):
            mipvog_bake.open(tmp_path / "a.mipvog", **options)


def test_addresses_need_a_permission_each_time():
    for open_or_bake in (
        lambda **options: mipvog_bake.open("https://[::1]:1/a.mipvog", **options),
        lambda **options: mipvog_bake.bake("https://[::1]:1/a.tar", "never.mipvog", **options),
    ):
        with pytest.raises(mipvog_bake.Error, match="allow") as refused:
            open_or_bake()
        assert refused.value.kind == "usage"
        # Nobody answers there.
        with pytest.raises(mipvog_bake.Error) as unanswered:
            open_or_bake(allow_network=True)
        assert unanswered.value.kind == "io"
        with pytest.raises(mipvog_bake.Error, match="allow"):
            open_or_bake()
