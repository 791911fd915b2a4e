"""Bakes a scene that is two functions: a soft ball with a gradient and a glossy term, in fog.

python from_numpy.py ball.mipvog
"""

import sys

import numpy as np

import mipvog_bake

BOX = ((-1, -1, -1), (1, 1, 1))


def density(positions):
    """Optical depth per world unit, [n]."""
    radius = np.linalg.norm(positions, axis=1)
    return 60 / (1 + np.exp(np.clip((radius - 0.6) / 0.012, -40, 40))) + 0.2 * (radius < 0.95)


def color(positions, directions):
    """Colours, [n, 3], of positions seen along unit directions that point into the scene."""
    normal = positions / np.maximum(np.linalg.norm(positions, axis=1, keepdims=True), 1e-6)
    mirrored = directions - 2 * (directions * normal).sum(axis=1, keepdims=True) * normal
    return 0.4 + 0.25 * positions + 0.2 * np.maximum(mirrored[:, 2:], 0)


def main(output, resolution=96):
    field = mipvog_bake.from_model(density, color, bounds=BOX, resolution=resolution)
    report = mipvog_bake.bake(field, output)
    print(f"{output}: {report['output_bytes']} bytes")


if __name__ == "__main__":
    main(*sys.argv[1:])
