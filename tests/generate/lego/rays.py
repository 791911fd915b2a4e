"""Rays that a program renders, and the file that tests read."""

import json
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file


def chosen(pictures, count=400, seed=1):
    """Three in four through pixels of the training's cameras, the others from all around."""
    random = np.random.default_rng(seed)
    cameras = json.loads((Path(pictures) / "transforms_train.json").read_text())
    half = np.tan(0.5 * cameras["camera_angle_x"])
    frames = np.array([frame["transform_matrix"] for frame in cameras["frames"]])
    seen = 3 * count // 4
    pose = frames[random.integers(len(frames), size=seen)]
    across = random.uniform(-half, half, (seen, 2))
    toward = np.concatenate([across, -np.ones((seen, 1))], 1)
    directions = np.einsum("nij,nj->ni", pose[:, :3, :3], toward)
    ball = random.normal(size=(count - seen, 3))
    ball *= random.uniform(2.5, 5, (count - seen, 1)) / np.linalg.norm(ball, axis=1, keepdims=True)
    targets = random.uniform(-0.8, 0.8, ball.shape)
    origins = np.concatenate([pose[:, :3, 3], ball])
    directions = np.concatenate([directions, targets - ball])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return origins.astype(np.float32), directions.astype(np.float32)


def write(path, origins, directions, **values):
    arrays = {"origins": origins, "directions": directions, **values}
    save_file({name: np.ascontiguousarray(a, np.float32) for name, a in arrays.items()}, path)
