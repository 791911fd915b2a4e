"""DirectVoxGO's CUDA parts in PyTorch: the same sums, for a processor."""

import sys
import types
from types import SimpleNamespace

import torch


def padded(values, ray_id, rays):
    """Values of each ray in a row, and where each stands in it."""
    counts = torch.bincount(ray_id, minlength=rays)
    column = torch.arange(len(ray_id)) - (counts.cumsum(0) - counts)[ray_id]
    rows = torch.zeros(rays, int(counts.max()) if len(ray_id) else 0)
    rows[ray_id, column] = values
    return rows, column


def sample_pts_on_rays(rays_o, rays_d, xyz_min, xyz_max, near, far, stepdist):
    safe = torch.where(rays_d == 0, torch.full_like(rays_d, 1e-6), rays_d)
    low, high = (xyz_min - rays_o) / safe, (xyz_max - rays_o) / safe
    t_min = torch.minimum(low, high).amax(1).clamp(near, far)
    t_max = torch.maximum(low, high).amin(1).clamp(near, far)
    norm = rays_d.norm(dim=1)
    steps = torch.ceil((t_max - t_min) * norm / stepdist).clamp(min=1).long()
    ray_id = torch.arange(len(rays_o)).repeat_interleave(steps)
    step_id = torch.arange(len(ray_id)) - (steps.cumsum(0) - steps)[ray_id]
    start, toward = rays_o + rays_d * t_min[:, None], rays_d / norm[:, None]
    points = start[ray_id] + toward[ray_id] * (stepdist * step_id)[:, None]
    outside = ((xyz_min > points) | (xyz_max < points)).any(1)
    return points, outside, ray_id, step_id, steps, t_min, t_max


def maskcache_lookup(world, xyz, scale, shift):
    place = xyz * scale + shift
    place = (place.sign() * torch.floor(place.abs() + 0.5)).long()
    inside = ((place >= 0) & (place < torch.tensor(world.shape))).all(1)
    found = torch.zeros(len(xyz), dtype=torch.bool)
    found[inside] = world[tuple(place[inside].T)]
    return found


def raw2alpha(density, shift, interval):
    grown = torch.exp(density + shift)
    return grown, 1 - torch.pow(1 + grown, -interval)


def raw2alpha_backward(grown, grad, interval):
    return grown.clamp(max=1e10) * torch.pow(1 + grown, -interval - 1) * interval * grad


def alpha2weight(alpha, ray_id, rays):
    rows, column = padded(alpha, ray_id, rays)
    after = torch.cumprod(1 - rows, 1)
    before = torch.cat([torch.ones(rays, 1), after[:, :-1]], 1) if rows.shape[1] else after
    # The march stops after the sample that leaves less than a thousandth.
    stopped = before < 1e-3
    weight, through = rows * before * ~stopped, torch.where(stopped, 1.0, before)
    last = torch.where(stopped, 1.0, after).amin(1) if rows.shape[1] else torch.ones(rays)
    ends = stopped[ray_id, column]
    return weight[ray_id, column], through[ray_id, column], last, ray_id, ends


def alpha2weight_backward(alpha, weight, through, last, ray_id, ends, rays, to_weight, to_last):
    light, column = padded(to_weight * weight, ray_id, rays)
    behind = light.flip(1).cumsum(1).flip(1) - light + (to_last * last)[:, None]
    grad = to_weight * through - behind[ray_id, column] / (1 - alpha + 1e-10)
    return grad * ~ends


def cumdist_thres(dist, threshold):
    run, mask = torch.zeros(len(dist)), torch.zeros(dist.shape, dtype=torch.bool)
    for at in range(dist.shape[1]):
        run = run + dist[:, at]
        mask[:, at] = run > threshold
        run = run * ~mask[:, at]
    return mask


def total_variation_add_grad(param, grad, wx, wy, wz, dense):
    added = torch.zeros_like(grad)
    # The original weighs x as z.
    for axis, weight in ((2, wz), (3, wy), (4, wz)):
        step = (weight / 6 * param.detach().diff(dim=axis)).clamp(-weight / 6, weight / 6)
        size = param.shape[axis] - 1
        added.narrow(axis, 1, size).add_(step)
        added.narrow(axis, 0, size).sub_(step)
    grad += added if dense else added * (grad != 0)


def adam(param, grad, mean, square, step, beta1, beta2, lr, eps, rate=1.0, only=None):
    size = lr * (1 - beta2**step) ** 0.5 / (1 - beta1**step)
    only = torch.ones_like(grad, dtype=torch.bool) if only is None else only
    mean.copy_(torch.where(only, beta1 * mean + (1 - beta1) * grad, mean))
    square.copy_(torch.where(only, beta2 * square + (1 - beta2) * grad * grad, square))
    param -= torch.where(only, size * rate * mean / (square.sqrt() + eps), torch.zeros_like(mean))


def masked_adam(param, grad, *rest):
    adam(param, grad, *rest, only=grad != 0)


def adam_with_rate(param, grad, mean, square, rate, *rest):
    adam(param, grad, mean, square, *rest, rate=rate)


def segment_coo(src, index, out, reduce):
    return out.index_add(0, index, src)


PARTS = SimpleNamespace(
    sample_pts_on_rays=sample_pts_on_rays,
    maskcache_lookup=maskcache_lookup,
    raw2alpha=raw2alpha,
    raw2alpha_backward=raw2alpha_backward,
    alpha2weight=alpha2weight,
    alpha2weight_backward=alpha2weight_backward,
    cumdist_thres=cumdist_thres,
    total_variation_add_grad=total_variation_add_grad,
    adam_upd=adam,
    masked_adam_upd=masked_adam,
    adam_upd_with_perlr=adam_with_rate,
)


def put_in(name, **contents):
    module = types.ModuleType(name)
    vars(module).update(contents)
    sys.modules[name] = module
