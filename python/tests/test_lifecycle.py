"""Fields as other open things of Python: closed, copied, pickled, replaced, forked, of bytes."""

import copy
import io
import multiprocessing
import pickle
import subprocess
import sys

import numpy as np
import pytest

import mipvog_bake

BOX = ((-1.2, -0.5, 0.3), (0.9, 1.0, 2.1))
ARRAYS = {
    "density": np.full((16, 16, 16), 2, np.float32),
    "color": np.full((16, 16, 16, 3), 0.5, np.float32),
    "aabb": BOX,
}
MIDDLE = np.array([[0.0, 0.2, 1.0]])


@pytest.fixture
def path(tmp_path):
    mipvog_bake.bake(ARRAYS, tmp_path / "a.mipvog")
    return tmp_path / "a.mipvog"


def fields(path):
    """A field of each kind of source."""
    diffuse = np.zeros((3, 16, 16, 16), np.float32)
    return [
        mipvog_bake.open(path),
        mipvog_bake.open(path.read_bytes()),
        mipvog_bake.from_arrays(ARRAYS["density"], diffuse=diffuse, bounds=BOX),
        mipvog_bake.from_model(
            lambda p: np.full(len(p), 3.0), lambda p, d: 0 * p + 0.25, bounds=BOX, resolution=8
        ),
    ]


def test_copies_and_pickles_show_the_same(path):
    for field in fields(path):
        for same in (pickle.loads(pickle.dumps(field)), copy.deepcopy(field), copy.copy(field)):
            assert same.bounds == field.bounds and same.report == field.report
            found, own = same.sample(MIDDLE), field.sample(MIDDLE)
            assert (found["density"] == own["density"]).all() and own["density"] > 0


def test_a_closed_field_says_so(path):
    for field in fields(path):
        with field as same:
            assert same is field and field.sample(MIDDLE)["density"] > 0
        assert field.dimensions
        with pytest.raises(mipvog_bake.Error, match="closed"):
            field.sample(MIDDLE)
        with pytest.raises(mipvog_bake.Error, match="closed"):
            pickle.dumps(field)
        with pytest.raises(mipvog_bake.Error, match="closed"):
            mipvog_bake.bake(field, path, force=True)


def test_what_is_given_out_can_be_changed(path):
    field = mipvog_bake.open(path)
    field.metadata.clear()
    field.levels.clear()
    assert field.metadata and field.levels


def test_a_file_is_baked_again_while_a_field_shows_it(path):
    old = mipvog_bake.open(path)
    dense = {**ARRAYS, "density": ARRAYS["density"] * 4}
    mipvog_bake.bake(dense, path, force=True, bits="f32")
    new = mipvog_bake.open(path)
    assert new.sample(MIDDLE)["density"] == pytest.approx(8, rel=0.02)
    assert old.sample(MIDDLE)["density"] == pytest.approx(2, rel=0.02)
    # What the call itself reads stays an input.
    with pytest.raises(mipvog_bake.Error) as raised:
        mipvog_bake.bake(path, path, force=True)
    assert raised.value.kind == "is_input"


def test_bytes_come_in_and_go_out(path):
    data = path.read_bytes()
    field = mipvog_bake.open(path)
    with path.open("rb") as file:
        for source in (data, bytearray(data), memoryview(data), io.BytesIO(data), file):
            found = mipvog_bake.open(source)
            assert (found.render(None, 16) == field.render(None, 16)).all()
    out = io.BytesIO()
    report = mipvog_bake.bake(ARRAYS, out)
    assert out.getvalue() == data and report["output_bytes"] == len(data)
    again = io.BytesIO()
    mipvog_bake.bake(data, again, force=True)
    assert mipvog_bake.open(again.getvalue()).dimensions == (16, 16, 16)
    with pytest.raises(mipvog_bake.Error) as raised:
        mipvog_bake.open(b"no container at all")
    assert len(str(raised.value)) < 400
    with pytest.raises(mipvog_bake.Error, match="mode 'rb'"):
        mipvog_bake.open(io.StringIO("text"))
    with pytest.raises(mipvog_bake.Error, match="standard output"):
        mipvog_bake.bake(ARRAYS, "-")


@pytest.mark.skipif(sys.platform != "linux", reason="forks")
@pytest.mark.parametrize("work", ["render", "probe", "unpack", "open", "arrays"])
def test_forked_children_go_on(path, work):
    field = mipvog_bake.open(path)
    arrays = fields(path)[2]
    field.render(None, 16)
    arrays.render(None, 16)
    rays = np.tile([[0.0, 0.2, 5.0]], (4000, 1)), np.tile([[0.0, 0.0, -1.0]], (4000, 1))

    def child():
        {
            "render": lambda: field.render(None, 16),
            "probe": lambda: field.probe(*rays),
            "unpack": lambda: field.unpack(),
            "open": lambda: mipvog_bake.open(path).render(None, 16),
            "arrays": lambda: arrays.render(None, 16),
        }[work]()

    process = multiprocessing.get_context("fork").Process(target=child)
    process.start()
    process.join(60)
    code = process.exitcode
    if code is None:
        process.kill()
    assert code == 0


def test_nodes_on_the_faces_of_the_callers_box_have_their_values(path):
    field = mipvog_bake.open(path)
    axes = [np.linspace(low, high, 16) for low, high in zip(*BOX, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    assert (field.sample(points)["density"] > 1.9).all()
    extent = np.subtract(*BOX[::-1])
    assert (field.sample(np.array([BOX[1]]) + 1e-4 * extent)["density"] == 0).all()


def test_the_program_needs_no_numpy():
    code = "import sys, mipvog_bake.__main__; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
