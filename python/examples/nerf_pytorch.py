"""Bakes a vanilla NeRF as `krrish94/nerf-pytorch` trains it: `FlexibleNeRFModel`, with directions.

    python nerf_pytorch.py checkpoint199999.ckpt lego.mipvog --resolution 192

The number of layers, their widths and the octaves of both encodings follow from the weights. The
box is that of its synthetic scenes unless `--bounds` gives another.
"""

import argparse

import torch
from torch.nn.functional import linear

import mipvog_bake

# All of the scenes' objects are within this of the origin.
HALF_SIDE = 1.5


class Nerf:
    """The network of a checkpoint: the fine one, where there are two."""

    def __init__(self, path, device):
        checkpoint = torch.load(path, map_location=device)
        fine, coarse = (checkpoint.get(f"model_{name}_state_dict") for name in ("fine", "coarse"))
        self.weights = fine or coarse
        if self.weights is None or "fc_alpha.weight" not in self.weights:
            raise SystemExit(f"{path}: no FlexibleNeRFModel with directions is in it")
        hidden = self.weights["layer1.weight"].shape[0]
        self.octaves = self._octaves("layer1", 0)
        self.view_octaves = self._octaves("layers_dir.0", hidden)

    def _octaves(self, layer, others):
        """An input of 3 numbers and of a sine and a cosine of each for every octave."""
        return (self.weights[f"{layer}.weight"].shape[1] - others - 3) // 6

    def _layer(self, name, values):
        return linear(values, self.weights[f"{name}.weight"], self.weights[f"{name}.bias"])

    def _body(self, positions):
        encoded = encode(positions, self.octaves)
        values = self._layer("layer1", encoded)
        number = 0
        while f"layers_xyz.{number}.weight" in self.weights:
            # A layer that skips takes the position again.
            if self.weights[f"layers_xyz.{number}.weight"].shape[1] > values.shape[1]:
                values = torch.cat([values, encoded], dim=1)
            values = torch.relu(self._layer(f"layers_xyz.{number}", values))
            number += 1
        return values

    def density(self, positions):
        return torch.relu(self._layer("fc_alpha", self._body(positions)))[:, 0]

    def color(self, positions, directions):
        features = torch.relu(self._layer("fc_feat", self._body(positions)))
        values = torch.cat([features, encode(directions, self.view_octaves)], dim=1)
        values = torch.relu(self._layer("layers_dir.0", values))
        return torch.sigmoid(self._layer("fc_rgb", values))


def encode(values, octaves):
    """The numbers, then the sines and the cosines of each octave."""
    waves = [
        wave(2.0**octave * values) for octave in range(octaves) for wave in (torch.sin, torch.cos)
    ]
    return torch.cat([values, *waves], dim=1)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkpoint")
    parser.add_argument("output")
    parser.add_argument("--resolution", type=int, default=192)
    parser.add_argument("--bounds", type=float, nargs=6, default=[-HALF_SIDE] * 3 + [HALF_SIDE] * 3)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    known = parser.parse_args(arguments)
    nerf = Nerf(known.checkpoint, known.device)
    field = mipvog_bake.from_model(
        nerf.density,
        nerf.color,
        bounds=(known.bounds[:3], known.bounds[3:]),
        resolution=known.resolution,
        device=known.device,
    )
    report = mipvog_bake.bake(field, known.output)
    psnr = report["view"]["held_out_psnr"]
    print(f"{known.output}: {report['output_bytes']} bytes, colours fitted to {psnr:.1f} dB")


if __name__ == "__main__":
    main()
