"""What from_model and bake take only with a word, or not at all."""

import warnings

import numpy as np
import pytest

import mipvog_bake

BOX = ((-1, -1, -1), (1, 1, 1))


def density(p):
    return 60 / (1 + np.exp(np.clip((np.linalg.norm(p, axis=1) - 0.55) / 0.012, -40, 40)))


def color(p, d):
    normal = p / np.maximum(np.linalg.norm(p, axis=1, keepdims=True), 1e-6)
    mirrored = d - 2 * (d * normal).sum(1, keepdims=True) * normal
    gloss = (0.5 + 0.5 * mirrored @ np.array([0.48, -0.6, 0.64])) ** 3
    return np.clip(0.3 + 0.25 * p + 0.25 * gloss[:, None], 0, 1)


@pytest.fixture(scope="module")
def field():
    return mipvog_bake.from_model(density, color, bounds=BOX, resolution=24)


def test_the_gate_judges_the_fit_that_was_made_before(field, tmp_path):
    own = field.report["view"]["held_out_psnr"]
    path = tmp_path / "a.mipvog"
    with pytest.raises(mipvog_bake.Error) as raised:
        mipvog_bake.bake(field, path, require_view_psnr=own + 1)
    assert raised.value.kind == "gate" and not path.exists()
    report = mipvog_bake.bake(field, path, require_view_psnr=own - 1)
    assert report["view"]["required_psnr"] == own - 1
    assert report["view"]["held_out_psnr"] == own and report["view"]["fitted"]


@pytest.mark.parametrize("view", ["sh:1", "none"])
def test_the_figure_of_fewer_bands_is_not_that_of_the_fit(field, tmp_path, view):
    report = mipvog_bake.bake(field, tmp_path / "a.mipvog", view=view)
    assert report["view"]["held_out_psnr"] is None
    with pytest.raises(mipvog_bake.Error) as raised:
        mipvog_bake.bake(field, tmp_path / "b.mipvog", view=view, require_view_psnr=1)
    assert raised.value.kind == "usage" and not (tmp_path / "b.mipvog").exists()


def test_a_gate_without_a_fit_is_refused(tmp_path):
    arrays = {
        "density": np.full((8, 8, 8), 2, np.float32),
        "color": np.full((8, 8, 8, 3), 0.5, np.float32),
        "aabb": BOX,
    }
    with pytest.raises(mipvog_bake.Error, match="nothing to judge") as raised:
        mipvog_bake.bake(arrays, tmp_path / "a.mipvog", require_view_psnr=60)
    assert raised.value.exit_code == 2 and not (tmp_path / "a.mipvog").exists()


def test_colours_of_bytes_are_refused_or_warned_of():
    def scaled(kind):
        return lambda p, d: (255 * color(p, d)).astype(kind)

    with pytest.raises(mipvog_bake.Error, match="divide the colours by 255"):
        mipvog_bake.from_model(density, scaled(np.uint8), bounds=BOX, resolution=8)
    with pytest.warns(UserWarning, match="expected 0 to 1"):
        mipvog_bake.from_model(density, scaled(np.float32), bounds=BOX, resolution=8)


def test_rays_tell_of_matter_that_samples_miss():
    def shell(p):
        return 600.0 * (np.abs(np.linalg.norm(p, axis=1) - 0.6) < 0.013)

    def grey(p, d):
        return 0 * p + 0.5

    with pytest.warns(UserWarning, match="thinner than a node spacing"):
        thin = mipvog_bake.from_model(shell, grey, bounds=BOX, resolution=24).report
    assert thin["transmittance"] > thin["model_transmittance"] + 0.1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ball = mipvog_bake.from_model(density, grey, bounds=BOX, resolution=48).report
    assert ball["picture_psnr"] > thin["picture_psnr"] + 5


def test_too_little_memory_is_told_before_the_scan():
    asked = []
    with pytest.raises(mipvog_bake.Error) as raised:
        mipvog_bake.from_model(
            lambda p: asked.append(len(p)), color, bounds=BOX, resolution=64, max_memory=1
        )
    assert raised.value.kind == "too_little_memory" and not asked


def test_progress_is_that_of_all_the_work():
    told = []
    mipvog_bake.from_model(
        density,
        color,
        bounds=BOX,
        resolution=64,
        progress=lambda step, share: told.append((step, share)),
    )
    shares = [share for _, share in told]
    assert shares == sorted(shares) and shares[-1] == 1
    assert len([step for step, _ in told if step == "find matter"]) > 2
    mipvog_bake.from_model(density, color, bounds=BOX, resolution=8, progress=True)


@pytest.mark.parametrize("degree", [2.5, "2", True, np.array([2]), 4])
def test_degrees_are_whole(degree):
    with pytest.raises(mipvog_bake.Error):
        mipvog_bake.from_model(density, color, bounds=BOX, resolution=8, sh_degree=degree)


def test_masked_values_are_refused():
    diffuse = np.zeros((3, 8, 8, 8), np.float32)
    whole = np.full((8, 8, 8), 5, np.float32)
    masked = np.ma.masked_array(whole, mask=whole > 4)
    with pytest.raises(mipvog_bake.Error, match="512 masked values"):
        mipvog_bake.from_arrays(masked, diffuse=diffuse, bounds=BOX)
    unmasked = np.ma.masked_array(whole, mask=False)
    assert mipvog_bake.from_arrays(unmasked, diffuse=diffuse, bounds=BOX).dimensions == (8, 8, 8)


def test_options_as_numpy_and_python_hold_them(field, tmp_path):
    path = tmp_path / "a.mipvog"
    options = {"bits": np.array(8), "force": np.True_, "alpha_threshold": None}
    report = mipvog_bake.bake(field, path, **options)
    assert report["options"]["bits"] == "8"
    assert report["options"]["alpha_threshold"] == pytest.approx(1e-4)
    report = mipvog_bake.bake(
        field, path, max_error=(0.02, 0.018, 0.05), size=(32, 24), turntable=1, force=True
    )
    assert report["options"]["max_error"] == "0.02:0.018:0.05"
