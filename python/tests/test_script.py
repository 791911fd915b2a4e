"""The script of the book's page: arrays to a container and back, and a picture of it."""

import numpy as np
from scenes import BOX, ball, camera

import mipvog_bake


def test_arrays_come_back_within_the_stated_error(tmp_path):
    density, diffuse = ball()
    field = mipvog_bake.from_arrays(density, diffuse=diffuse, bounds=BOX, shift=0.0, stepsize=0.5)
    report = mipvog_bake.bake(field, tmp_path / "ball.mipvog", bits=12)
    baked = mipvog_bake.open(tmp_path / "ball.mipvog")
    values = baked.unpack()
    stored = np.kron(values["level0.occupied"] == 1, np.ones((8, 8, 8))).astype(bool)
    stored &= density > 0

    def opacity(raw):
        return 1 - np.exp(-np.log1p(np.exp(raw)) * 0.5)

    groups = {group["group"]: group["max_error"] for group in report["levels"][0]["groups"]}
    off = np.abs(opacity(values["level0.density"]) - opacity(density))[stored]
    assert stored.sum() > 1000 and off.max() <= groups["density"] * 1.001
    color = 1 / (1 + np.exp(-values["level0.diffuse"])) - 1 / (1 + np.exp(-diffuse))
    assert np.abs(color)[:, stored].max() <= groups["diffuse"] * 1.001
    picture = baked.render(camera((0, -4, 0)), (48, 32))
    assert picture.shape == (32, 48, 3) and picture.dtype == np.float32
    assert picture[0, 0].min() > 0.99 and picture[16, 24].max() < 0.9
    assert report["output_bytes"] == (tmp_path / "ball.mipvog").stat().st_size
    assert report["schema"] == "mipvog-bake/1" and report["input"] == "arrays"
