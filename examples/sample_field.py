"""Samples any radiance field into a file of arrays for `mipvog-bake`.

    python sample_field.py ball.npz && mipvog-bake bake ball.npz -o ball.mipvog

Put your own model in place of `density` and `color`: any activation, any contraction, any scale.
"""

import sys

import numpy as np

LOW, HIGH, SIDE = np.array([-1.0] * 3), np.array([1.0] * 3), 48


def density(points):
    """Optical depth per world unit, [n]; negative where there is nothing."""
    return 40.0 * (0.7 - np.linalg.norm(points, axis=-1))


def color(points, directions):
    """Colours, [n, 3], of points seen along unit directions that point into the scene."""
    normal = points / np.maximum(np.linalg.norm(points, axis=-1, keepdims=True), 1e-9)
    shine = np.maximum(-(normal * directions).sum(-1, keepdims=True), 0.0)
    return 0.2 + 0.6 * shine * np.array([1.0, 0.8, 0.6])


def basis(d):
    """The spherical harmonics of degree 0 and 1, [n, 4]."""
    c = 0.4886025119029199
    one = np.full(len(d), 0.28209479177387814)
    return np.stack([one, -c * d[:, 1], c * d[:, 2], -c * d[:, 0]], axis=1)


axes = [np.linspace(low, high, SIDE) for low, high in zip(LOW, HIGH)]
nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
directions = np.random.default_rng(1).normal(size=(64, 3))
directions /= np.linalg.norm(directions, axis=1, keepdims=True)

# The coefficients that fit the colours along all directions best.
seen = np.stack([color(nodes, np.broadcast_to(d, nodes.shape)) for d in directions])
fit = np.linalg.pinv(basis(directions)) @ (seen - 0.5).reshape(len(directions), -1)
sh = fit.reshape(4, SIDE, SIDE, SIDE, 3).transpose(1, 2, 3, 4, 0)

np.savez(
    sys.argv[1],
    density=density(nodes).reshape(SIDE, SIDE, SIDE).astype(np.float32),
    sh=sh.astype(np.float16),
    aabb=np.array([LOW, HIGH], np.float32),
    offset=0.5,
    clamp="zero",
    background=np.ones(3, np.float32),
)
