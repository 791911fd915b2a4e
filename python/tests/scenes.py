"""Small scenes that the tests share."""

import os

import numpy as np
import pytest

# Marks tests that take long: `.ci/night` runs them, the gate leaves them out.
night = pytest.mark.skipif("MIPVOG_NIGHT" not in os.environ, reason="MIPVOG_NIGHT is not set")


def ball(nodes=24):
    """Raw density and logits of colour of a ball of radius 0.7 in a box of half size 1."""
    axis = np.linspace(-1, 1, nodes, dtype=np.float32)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    inside = np.sqrt(x * x + y * y + z * z) < 0.7
    density = np.where(inside, 8.0, -8.0).astype(np.float32)
    diffuse = np.stack([3 * x, 3 * y, 3 * z]).astype(np.float32)
    return density, diffuse


BOX = ((-1, -1, -1), (1, 1, 1))


def sampled_arrays(nodes=24):
    """The same as sampled arrays."""
    density, diffuse = ball(nodes)
    color = np.ascontiguousarray(np.moveaxis(1 / (1 + np.exp(-diffuse)), 0, -1), dtype=np.float32)
    return {"density": np.where(density > 0, 40, 0).astype(np.float32), "color": color, "aabb": BOX}


def camera(eye, target=(0, 0, 0)):
    """A matrix from camera to world, which looks at the target with z up."""
    eye, target = np.asarray(eye, float), np.asarray(target, float)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    return matrix


def psnr(found, expected):
    """Of pictures from 0 to 1."""
    error = np.mean((np.clip(found, 0, 1) - np.clip(expected, 0, 1)) ** 2)
    return -10 * np.log10(max(error, 1e-20))
