"""Writes fixtures/golden/ssim.safetensors: pairs of pictures and the structural similarity that
scikit-image finds.

    python3 tests/generate/similarity.py

Python 3.11, NumPy 2, scikit-image 0.26, from the repository's root. Pictures are formulas, so that
they are the same everywhere.
"""
import numpy as np
from skimage.metrics import structural_similarity
import tensor_file


def picture(height, width, phase):
    """Waves of a few pixels with an edge through them, of each channel its own."""
    y, x, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(3), indexing="ij")
    waves = np.sin(0.71 * x + 0.23 * y * (c + 1) + phase) * np.cos(0.37 * y - 0.11 * x * c)
    return np.clip(0.5 + 0.3 * waves + 0.2 * (x > y), 0, 1).astype(np.float32)


def disturbed(image, strength):
    grain = (np.arange(image.size, dtype=np.uint64) * np.uint64(2654435761) >> np.uint64(9)) & np.uint64(255)
    return np.clip(image + strength * (grain.reshape(image.shape) / 255.0 - 0.5), 0, 1).astype(np.float32)


arrays = {}
for name, height, width, strength in [("odd", 29, 37, 0.2), ("wide", 12, 40, 0.6), ("window", 11, 11, 0.1)]:
    want = picture(height, width, 0.0)
    got = disturbed(picture(height, width, 0.15), strength)
    arrays[f"{name}.want"], arrays[f"{name}.got"] = want, got
    similarity = structural_similarity(
        want.astype(np.float64), got.astype(np.float64), gaussian_weights=True, sigma=1.5,
        use_sample_covariance=False, data_range=1.0, channel_axis=2,
    )
    arrays[f"{name}.ssim"] = np.array([similarity])
    print(name, similarity)
tensor_file.write("fixtures/golden/ssim.safetensors", arrays)
