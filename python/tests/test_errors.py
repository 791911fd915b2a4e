"""Every bad input is an exception that says what to do, and nothing is half written."""

import os
import signal
import threading

import numpy as np
import pytest
from scenes import BOX, ball, sampled_arrays

import mipvog_bake


def failed(tmp_path, match, exit_code, work):
    """The error of work that leaves nothing behind."""
    with pytest.raises(mipvog_bake.Error, match=match) as raised:
        work(tmp_path / "out.mipvog")
    assert raised.value.exit_code == exit_code and raised.value.kind
    assert list(tmp_path.iterdir()) == []
    return raised.value


@pytest.mark.parametrize(
    "name, change, match",
    [
        ("density", lambda a: a.astype(np.int32), r"dtype int32.*\n.*astype\(numpy.float32\)"),
        ("density", lambda a: a.astype(complex), "dtype complex128"),
        ("density", lambda a: a[::-1], r"strides.*\n.*ascontiguousarray\(density\)"),
        ("color", lambda a: a[:, :, ::-1], r"ascontiguousarray\(color\)"),
        ("density", lambda a: a[:-1], "color.*shape .24, 24, 24, 3. for density of shape .23"),
        ("color", lambda a: a[..., :2], "color.*the shape of density, then 3"),
        ("aabb", lambda a: ((0, 0, 0), (0, 1, 1)), "aabb"),
    ],
)
def test_arrays_that_do_not_fit(tmp_path, name, change, match):
    arrays = sampled_arrays()
    arrays[name] = change(arrays[name])
    error = failed(tmp_path, match, 3, lambda out: mipvog_bake.bake(arrays, out))
    assert error.file == "arrays" and error.place in (f"tensor {name}", "tensor color")


def test_numbers_that_are_not_finite(tmp_path):
    arrays = sampled_arrays()
    arrays["density"][3, 4, 5] = np.nan
    error = failed(tmp_path, "not finite", 3, lambda out: mipvog_bake.bake(arrays, out))
    assert error.kind == "non_finite" and "(3, 4, 5)" in str(error)
    assert "nonfinite" in error.help and "--" not in error.help
    density, diffuse = ball()
    diffuse[0, 12, 12, 12] = np.inf
    field = mipvog_bake.from_arrays(density, diffuse=diffuse, bounds=BOX)
    failed(tmp_path, "not finite", 3, lambda out: mipvog_bake.bake(field, out))


def test_names_that_are_unknown(tmp_path):
    arrays = sampled_arrays() | {"colour": 1}
    failed(tmp_path, "'colour'.*\n.*color", 3, lambda out: mipvog_bake.bake(arrays, out))
    failed(
        tmp_path, "found no aabb", 3, lambda out: mipvog_bake.bake({"density": 1.0, "sh": 1.0}, out)
    )
    failed(tmp_path, "bit_s", 2, lambda out: mipvog_bake.bake(sampled_arrays(), out, bit_s=8))
    failed(tmp_path, "bits", 2, lambda out: mipvog_bake.bake(sampled_arrays(), out, bits=99))
    arrays = sampled_arrays()
    failed(tmp_path, "format", 2, lambda out: mipvog_bake.bake(arrays, out, format="text"))
    failed(tmp_path, "expected a path", 2, lambda out: mipvog_bake.bake(3, out))


def test_shapes_of_trained_arrays():
    density, diffuse = ball()
    with pytest.raises(mipvog_bake.Error, match="diffuse.*shape .24, 24, 24, 3."):
        mipvog_bake.from_arrays(density, diffuse=np.moveaxis(diffuse, 0, -1), bounds=BOX)
    with pytest.raises(mipvog_bake.Error, match=r"density.*shape .1, 24"):
        mipvog_bake.from_arrays(density[None], diffuse=diffuse, bounds=BOX)
    with pytest.raises(mipvog_bake.Error, match="bounds"):
        mipvog_bake.from_arrays(density, diffuse=diffuse, bounds=(0, 1))


def test_files_that_are_missing_or_there(tmp_path):
    with pytest.raises(mipvog_bake.Error, match="check the path") as raised:
        mipvog_bake.open(tmp_path / "none.mipvog")
    error = raised.value
    assert (error.kind, error.exit_code) == ("io", 5) and error.file.endswith("none.mipvog")
    out = tmp_path / "out.mipvog"
    mipvog_bake.bake(sampled_arrays(), out)
    before = out.read_bytes()
    with pytest.raises(mipvog_bake.Error, match="pass force") as raised:
        mipvog_bake.bake(sampled_arrays(), out)
    assert (raised.value.kind, raised.value.exit_code) == ("exists", 7)
    mipvog_bake.bake(sampled_arrays(), out, force=True)
    assert out.read_bytes() == before
    out.write_bytes(before[:-9])
    with pytest.raises(mipvog_bake.Error) as raised:
        mipvog_bake.open(out)
    assert raised.value.exit_code == 3 and raised.value.file.endswith("out.mipvog")


def test_a_missed_gate_has_its_report(tmp_path):
    def work(out):
        mipvog_bake.bake(sampled_arrays(), out, turntable=2, size="32x32", bits=4, require_psnr=99)

    error = failed(tmp_path, "99", 1, work)
    assert error.kind == "gate" and error.report["quality"]["passed"] is False


def test_progress_grows_and_may_end_the_work(tmp_path):
    told = []
    arrays = sampled_arrays(96)
    mipvog_bake.bake(arrays, tmp_path / "a.mipvog", progress=lambda *now: told.append(now))
    shares = [share for _, share in told]
    assert told and shares == sorted(shares) and shares[0] >= 0 and shares[-1] <= 1
    (tmp_path / "a.mipvog").unlink()

    def refuse(step, share):
        raise LookupError("enough")

    # Long enough to be told of amid the work.
    slow = sampled_arrays(160)
    with pytest.raises(LookupError, match="enough"):
        mipvog_bake.bake(slow, tmp_path / "a.mipvog", progress=refuse, zstd_level=19)
    assert list(tmp_path.iterdir()) == []
    # The work may have ended by then: the output is whole or not there.
    with pytest.raises(LookupError, match="enough"):
        mipvog_bake.bake(sampled_arrays(), tmp_path / "a.mipvog", progress=refuse)
    for path in tmp_path.iterdir():
        assert path.name == "a.mipvog" and mipvog_bake.open(path).dimensions == (24, 24, 24)
    # A model has progress, too.
    with pytest.raises(LookupError, match="enough"):
        mipvog_bake.from_model(
            lambda p: p[:, 0] + 2, lambda p, d: p, bounds=BOX, resolution=8, progress=refuse
        )


def test_ctrl_c_ends_the_work(tmp_path):
    arrays = sampled_arrays(200)
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        for _ in range(100):
            mipvog_bake.bake(arrays, tmp_path / "a.mipvog", force=True, zstd_level=19)
    assert [path.name for path in tmp_path.iterdir()] in ([], ["a.mipvog"])


def test_other_threads_run_while_a_bake_works(tmp_path):
    ticks = []
    done = threading.Event()

    def tick():
        while not done.wait(0.001):
            ticks.append(1)

    thread = threading.Thread(target=tick)
    thread.start()
    mipvog_bake.bake(sampled_arrays(96), tmp_path / "a.mipvog")
    done.set()
    thread.join()
    assert len(ticks) > 10
