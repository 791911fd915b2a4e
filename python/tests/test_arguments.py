"""A wrong argument of any function is an `Error` that names it; nothing of NumPy gets out."""

from functools import partial

import numpy as np
import pytest
from scenes import BOX, ball, sampled_arrays

import mipvog_bake

RAY = ([[0, 0, 4]], [[0, 0, -1]])
FEATURES = np.zeros((4, 24, 24, 24), np.float32)
BLOCKS = {
    "density": np.ones((2, 8, 8, 8), np.float32),
    "color": np.ones((2, 8, 8, 8, 3), np.float32),
    "blocks": np.array([[0, 0, 0], [1, 1, 1]]),
    "block_size": 8,
    "aabb": BOX,
}


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    path = tmp_path_factory.mktemp("arguments") / "ball.mipvog"
    mipvog_bake.bake(sampled_arrays(), path)
    return mipvog_bake.open(path)


def refused(work, match, exit_code=2):
    with pytest.raises(mipvog_bake.Error, match=match) as raised:
        work()
    assert raised.value.exit_code == exit_code, raised.value
    return raised.value


@pytest.mark.parametrize(
    "change, match",
    [
        ({"offset": "a"}, "offset: found dtype <U1, expected a number"),
        ({"offset": [1, 2]}, r"offset: found \[1, 2\], expected a number"),
        ({"offset": object()}, "offset: found dtype object"),
        ({"clamp": "one"}, "clamp: found 'one', expected zero, none, sigmoid"),
        ({"background": (1, 2)}, "background: .*expected 3 numbers"),
        ({"stepsize": float("nan")}, "stepsize: found nan, expected a number"),
    ],
)
def test_settings_of_sampled_arrays(tmp_path, change, match):
    refused(lambda: mipvog_bake.bake(sampled_arrays() | change, tmp_path / "a.mipvog"), match)
    assert list(tmp_path.iterdir()) == []


def test_settings_of_an_npz_are_taken(tmp_path):
    settings = {"clamp": "none", "offset": 0.25, "background": (0, 0, 0)}
    np.savez(tmp_path / "a.npz", **sampled_arrays(), **settings)
    mipvog_bake.bake(dict(np.load(tmp_path / "a.npz")), tmp_path / "a.mipvog")
    mipvog_bake.bake(tmp_path / "a.npz", tmp_path / "b.mipvog")
    assert mipvog_bake.open(tmp_path / "a.mipvog").metadata["background"] == [0, 0, 0]
    values = [mipvog_bake.open(tmp_path / name).unpack() for name in ("a.mipvog", "b.mipvog")]
    assert all(np.array_equal(values[0][name], values[1][name]) for name in values[0])


@pytest.mark.parametrize(
    "change, match",
    [
        ({"blocks": np.zeros((2, 3))}, r"tensor blocks: found dtype float64.*\n.*astype"),
        ({"blocks": BLOCKS["blocks"][::-1]}, r"tensor blocks: found strides.*\n.*ascontig"),
        ({"blocks": np.full((2, 3), -1)}, "found block .-1, -1, -1."),
        ({"block_size": None}, "one of blocks and block_size"),
        ({"density": "abc"}, "tensor density: found dtype <U3"),
        ({"density": [[1], [2, 3]]}, "tensor density: found list that NumPy cannot read"),
        ({"aabb": ((0, 0, 0), (1, 1, np.nan))}, "tensor aabb: .*expected finite corners"),
    ],
)
def test_blocks_that_do_not_fit(tmp_path, change, match):
    refused(lambda: mipvog_bake.bake(BLOCKS | change, tmp_path / "a.mipvog"), match, 3)
    assert list(tmp_path.iterdir()) == []


def test_numbers_that_are_not_finite_have_the_name_of_their_array(tmp_path):
    density, diffuse = ball()
    colors = np.full_like(sampled_arrays()["color"], np.nan)
    harmonics = np.full((24, 24, 24, 3, 4), np.nan, np.float32)
    plain = sampled_arrays()
    cases = {
        "color": plain | {"color": colors},
        "sh": {"density": plain["density"], "aabb": BOX, "sh": harmonics},
        "diffuse": mipvog_bake.from_arrays(density, diffuse=diffuse * np.nan, bounds=BOX),
        "density": mipvog_bake.from_arrays(density * np.nan, diffuse=diffuse, bounds=BOX),
    }
    for name, source in cases.items():
        match = f"^arrays: tensor {name}: found .* not finite"
        error = refused(partial(mipvog_bake.bake, source, tmp_path / "a.mipvog"), match, 3)
        assert (error.kind, error.file) == ("non_finite", "arrays")
        assert error.place == f"tensor {name}"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "change, match, exit_code",
    [
        ({"density": ball()[0].astype(int)}, r"tensor density: .*int64.*\n.*density.astype", 3),
        ({"diffuse": ball()[1].astype(int)}, r"tensor diffuse: .*int64.*\n.*diffuse.astype", 3),
        ({"density": ball()[0][::-1]}, r"strides.*\n.*ascontiguousarray\(density\)", 3),
        ({"diffuse": ball()[1][:, ::-1]}, r"strides.*\n.*ascontiguousarray\(diffuse\)", 3),
        ({"features": FEATURES[:, :-1]}, r"features: found shape .4, 23, 24, 24.", 3),
        ({"bounds": BOX[::-1]}, "bounds: .*expected finite corners", 3),
        ({"bounds": {"min": 0}}, "bounds: .*expected two corners", 3),
        ({"shift": "a"}, "shift: found 'a', expected a finite number", 2),
        ({"shift": float("nan")}, "shift: found nan", 2),
        ({"interval": 0}, "interval: found 0, expected a number of voxels above 0", 2),
        ({"interval": 1, "stepsize": 0}, "stepsize: found 0", 2),
        ({"stepsize": None}, "stepsize: found None", 2),
        ({"near": "a"}, "near: found 'a'", 2),
        ({"near": 2, "far": 1}, "far: found 1, expected a distance beyond near", 2),
        ({"background": (1, 2)}, "background: found .1, 2., expected three numbers", 2),
        ({"color_threshold": "a"}, "color_threshold: found 'a'", 2),
        ({"frequencies": 1.5}, "frequencies: found 1.5", 2),
        ({"features": FEATURES, "network": 3}, "network: found no pairs", 2),
        ({"features": FEATURES, "network": [3]}, "network: found no pairs", 2),
        ({"features": FEATURES, "network": {"a": 3}}, "network: found 'a', expected pairs", 2),
        ({"features": FEATURES, "network": [(np.zeros((3, 9)), np.zeros(3))]}, "9 wide", 4),
    ],
)
def test_trained_arrays(change, match, exit_code):
    density, diffuse = ball()
    sound = {"density": density, "diffuse": diffuse, "bounds": BOX}
    refused(lambda: mipvog_bake.from_arrays(**(sound | change)), match, exit_code)


@pytest.mark.parametrize(
    "change, match",
    [
        ({"resolution": "a"}, "resolution: found dtype"),
        ({"resolution": None}, "resolution: found dtype object"),
        ({"resolution": 8.5}, "resolution: found 8.5"),
        ({"resolution": (8, 8)}, "resolution: found .8, 8., expected 2 to 4096"),
        ({"background": "red"}, "background: found dtype"),
        ({"background": (1, 1)}, "background: found .1, 1., expected three numbers"),
        ({"cameras": object()}, "cameras: found dtype object, expected a camera file"),
        ({"cameras": [[1], [1, 2]]}, "cameras: found list that NumPy cannot read"),
        ({"max_memory": 1e9}, "max_memory: found 1000000000.0, expected a number of bytes"),
        ({"progress": 3}, "progress: found int, expected a function"),
    ],
)
def test_options_of_models(change, match):
    options = {"bounds": BOX, "resolution": 8} | change
    refused(lambda: mipvog_bake.from_model(lambda p: p[:, 0] + 2, lambda p, d: p, **options), match)


def test_files_and_options_of_a_bake(tmp_path):
    out = tmp_path / "a.mipvog"
    for output in (None, 3):
        refused(partial(mipvog_bake.bake, sampled_arrays(), output), "output: found .*a path")
    refused(lambda: mipvog_bake.open(None), "path: found NoneType, expected a path")
    refused(lambda: mipvog_bake.bake(sampled_arrays(), out, progress=3), "progress: found int")
    # A name that is unknown is refused though its value gives no option.
    refused(lambda: mipvog_bake.bake(sampled_arrays(), out, nonsense=None), "nonsense")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "work, match",
    [
        (lambda f: f.unpack("a"), "levels: found 'a'"),
        (lambda f: f.unpack(-1), "levels: found -1"),
        (lambda f: f.unpack(1.5), "levels: found 1.5"),
        (lambda f: f.unpack([]), "levels: found no number"),
        (lambda f: f.probe("a", RAY[1]), "origins: found dtype"),
        (lambda f: f.probe([[0, 0], [1]], RAY[1]), "origins: found list that NumPy cannot read"),
        (lambda f: f.probe([0, 0, 4], RAY[1]), r"origins: found shape \(3,\), expected \[n, 3\]"),
        (lambda f: f.probe([[0, 0, np.nan]], RAY[1]), "origins: .*not finite"),
        (lambda f: f.probe(RAY[0], [[0, 0, 0]]), "directions: found one of length 0"),
        (lambda f: f.probe([[0, 0, 4]] * 2, RAY[1]), "2 origins and 1 directions"),
        (lambda f: f.probe(np.array(RAY[0]) + 1j, RAY[1]), "origins: found dtype complex128"),
        (lambda f: f.probe(*RAY, level=99), "level: found 99"),
        (lambda f: f.probe(*RAY, level="a"), "level: found 'a'"),
        (lambda f: f.sample(None), "positions: found dtype object"),
        (lambda f: f.sample(RAY[0], level=99), "level: found 99"),
        (lambda f: f.render(None, "32x32"), "size: found '32x32'"),
        (lambda f: f.render(None, None), "size: found None"),
        (lambda f: f.render(None, (1, 2, 3)), "size: found .1, 2, 3."),
        (lambda f: f.render(None, (32.5, 32)), "size: found 32.5"),
        (lambda f: f.render(3, 8), r"camera: found a matrix of shape \(\)"),
        (lambda f: f.render(np.full((4, 4), np.nan), 8), "camera: .*not finite"),
        (lambda f: f.render({"angle": 1}, 8), "camera: found a dictionary of 'angle'"),
        (lambda f: f.render({"frames": [object()]}, 8), "camera: found object"),
        (lambda f: f.render(None, 8, progress=3), "progress: found int"),
    ],
)
def test_questions_to_a_field(field, work, match):
    refused(lambda: work(field), match)


def test_numbers_of_numpy_are_numbers(field):
    assert field.unpack(np.int64(1)).keys() == field.unpack(1).keys()
    assert field.render(None, np.array([16, 8])).shape == (8, 16, 3)
    frame = {"transform_matrix": np.eye(4), "camera_angle_x": np.float32(0.7)}
    assert np.array_equal(field.render({"frames": [frame]}, 8), field.render(frame, 8))
