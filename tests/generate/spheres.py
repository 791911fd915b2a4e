"""Makes the fixtures of Plenoxels with background spheres.

    python3 tests/generate/spheres.py fixtures/grids

Needs NumPy and safetensors. Writes `plenoxels_spheres.npz`, a small world in svox2's layout: a ball
in the box, hills, a ground and a sky around it; and, for it and for `plenoxels_background.npz`, rays
by a renderer in float64 that follows svox2's kernels for graphics cards step by step
(`render_lerp_kernel_cuvol.cu`: the box, then `render_background_forward`).
"""

import sys
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

BAND_0 = 0.28209479177387814
BAND_1 = 0.4886025119029199
STEP, STOP, LEAST_SIGMA, WHITE = 0.5, 1e-7, 1e-8, 1.0


def world(cells=16, along=16, layers=8):
    axis = (2 * np.arange(cells) + 1) / cells - 1
    place = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    density = (0.55 - np.linalg.norm(place - [0.1, 0.0, -0.1], axis=-1)) * 60
    full = density > -12
    links = np.full(full.shape, -1, np.int32)
    links[full] = np.arange(full.sum())
    colors = np.zeros((full.sum(), 3, 4), np.float32)
    colors[:, :, 0] = np.sin(3 * place[full] + [0, 1, 2])
    colors[:, :, 1:] = 0.2 * np.cos(2 * place[full])[:, None, :]
    lon = (np.arange(2 * along) / (2 * along) - 0.5) * 2 * np.pi
    lat = (0.5 - np.arange(along) / along) * np.pi
    lon, lat = (grid[..., None] for grid in np.meshgrid(lon, lat, indexing="ij"))
    layer = (np.arange(layers) + 0.5) / layers
    hills = 0.62 + 0.12 * np.sin(2 * lon)
    sigma = 90 * np.clip((layer - hills) * layers, 0, 1) * (lat < 0.3 + 0.1 * np.sin(3 * lon))
    sigma = np.maximum(sigma, 90 * (layer > 0.6) * (lat < -0.3))
    sigma = np.maximum(sigma, 90 * (layer > 0.9))
    data = np.zeros(np.broadcast_shapes(sigma.shape, lon.shape) + (4,), np.float32)
    data[..., 0] = np.sin(lon) * np.cos(lat)
    data[..., 1] = np.sin(2 * lat) + 0 * lon
    data[..., 2] = 1.2 * layer - 0.4
    data[..., 3] = sigma
    return {
        "radius": np.ones(3, np.float32),
        "center": np.zeros(3, np.float32),
        "links": links,
        "density_data": density[full][:, None].astype(np.float32),
        "sh_data": colors.reshape(len(colors), -1).astype(np.float16),
        "basis_type": np.array(1),
        "background_links": np.arange(2 * along * along, dtype=np.int32).reshape(-1, along),
        "background_data": data.reshape(-1, layers, 4),
    }


def functions(direction, count):
    x, y, z = direction
    return np.array([BAND_0, -BAND_1 * y, BAND_1 * z, -BAND_1 * x][:count])


def box(scene, origin, direction):
    """Colour and optical depth of the box."""
    links, cells = scene["links"], np.array(scene["links"].shape)
    radius, center = scene["radius"].astype(float), scene["center"].astype(float)
    at = (origin - center + radius) / (2 * radius) * cells - 0.5
    by = direction * cells / (2 * radius)
    length = 1 / np.linalg.norm(by)
    by = by * length
    start, end = 0.0, 2e3
    for from_, along, count in zip(at, by, cells):
        if along != 0:
            ends = sorted([(-0.5 - from_) / along, (count - 0.5 - from_) / along])
            start, end = max(start, ends[0]), min(end, ends[1])
    color, depth, t = np.zeros(3), 0.0, start
    count = scene["sh_data"].shape[1] // 3
    basis = functions(direction, count)
    while t <= end + 1e-9:
        place = np.clip(at + t * by, 0, cells - 1)
        low = np.minimum(place.astype(int), cells - 2)
        share = place - low
        sigma, sums = 0.0, np.zeros((3, count))
        for corner in np.ndindex(2, 2, 2):
            row = links[tuple(low + corner)]
            if row >= 0:
                weight = np.prod(np.where(corner, share, 1 - share))
                sigma += weight * float(scene["density_data"][row, 0])
                sums += weight * scene["sh_data"][row].astype(float).reshape(3, count)
        if sigma > LEAST_SIGMA:
            own = STEP * length * sigma
            color += np.exp(-depth) * (1 - np.exp(-own)) * np.maximum(sums @ basis + 0.5, 0)
            depth += own
            if np.exp(-depth) < STOP:
                return color, 1e3
        t += STEP
    return color, depth


def spheres(scene, origin, direction, color, depth):
    """What is behind the box, added."""
    links, data = scene["background_links"], scene["background_data"].astype(float)
    layers, along = data.shape[1], links.shape[1]
    radius = scene["radius"].astype(float)
    at, by = (origin - scene["center"].astype(float)) / radius, direction / radius
    unit = 1 / np.linalg.norm(by)
    by = by * unit
    inner = max(np.linalg.norm(np.cross(at, by)) + 1e-3, 1.0)
    last, count = 1 / inner, int(layers / STEP) + 2
    for number in range(count):
        r = count / (count - number - 0.5)
        if r < inner:
            continue
        t = -(at @ by) + np.sqrt((at @ by) ** 2 - at @ at + r * r)
        place = at + t * by
        inverse = 1 / np.linalg.norm(place)
        place = place * inverse
        u = 2 * along * (0.5 + np.arctan2(place[0], place[2]) / 2 / np.pi)
        v = along * (0.5 - np.arcsin(np.clip(place[1], -1, 1)) / np.pi)
        w = min(max((1 - inverse) * layers - 0.5, 0), layers - 1)
        i, j, k = min(int(u), 2 * along - 1), min(int(v), along - 1), min(int(w), layers - 2)
        values = np.zeros(4)
        for x, x_share in ((i, 1 - u + i), ((i + 1) % (2 * along), u - i)):
            for y, y_share in ((j, 1 - v + j), ((j + 1) % along, v - j)):
                row = links[x, y]
                if row >= 0:
                    own = data[row, k] * (1 - w + k) + data[row, k + 1] * (w - k)
                    values += x_share * y_share * own
        if values[3] > 0:
            own = (last - inverse) * unit * values[3]
            seen = np.maximum(values[:3] * BAND_0 + 0.5, 0)
            color = color + np.exp(-depth) * (1 - np.exp(-own)) * seen
            depth += own
            if np.exp(-depth) < STOP:
                break
        last = inverse
    return color, depth


def rays(scene, count, reach, random):
    origins = random.uniform(-reach, reach, (count, 3)).astype(np.float32)
    directions = random.normal(size=(count, 3))
    directions = (directions / np.linalg.norm(directions, axis=1)[:, None]).astype(np.float32)
    colors, left = [], []
    for origin, direction in zip(origins.astype(float), directions.astype(float)):
        direction = direction / np.linalg.norm(direction)
        color, depth = spheres(scene, origin, direction, *box(scene, origin, direction))
        colors.append(color + np.exp(-depth) * WHITE)
        left.append(np.exp(-depth))
    return {
        "origins": origins,
        "directions": directions,
        "rgb": np.array(colors, np.float32),
        "transmittance": np.array(left, np.float32),
    }


folder = Path(sys.argv[1])
np.savez_compressed(folder / "plenoxels_spheres.npz", **world())
# Rays from outside of the unit sphere see far halves of spheres alone.
for name, reach in (("plenoxels_spheres", 0.6), ("plenoxels_background", 1.5)):
    scene = dict(np.load(folder / f"{name}.npz"))
    found = rays(scene, 300, reach, np.random.default_rng(7))
    save_file(found, folder / f"{name}.rays.safetensors")
