"""Shrinks pictures of "lego" to 100 x 100, and writes their cameras as NeRF-synthetic has them.

    python pictures.py SCENE... OUTPUT

Each SCENE has `transforms_test.json` and some of its pictures.
"""

import json
import sys
from pathlib import Path

from PIL import Image

*scenes, out = map(Path, sys.argv[1:])
frames = {}
for scene in scenes:
    cameras = json.loads((scene / "transforms_test.json").read_text())
    for frame in cameras["frames"]:
        picture = scene / (frame["file_path"] + ".png")
        if picture.exists():
            frames[picture.stem] = (picture, frame)
for name, (picture, _) in frames.items():
    image = Image.open(picture).convert("RGBA").resize((100, 100), Image.BOX)
    (out / "train").mkdir(parents=True, exist_ok=True)
    image.save(out / "train" / f"{name}.png")
kept = [dict(frame, file_path=f"./train/{name}") for name, (_, frame) in sorted(frames.items())]
for split in ("train", "val", "test"):
    part = kept if split == "train" else kept[:1]
    text = {"camera_angle_x": cameras["camera_angle_x"], "frames": part}
    (out / f"transforms_{split}.json").write_text(json.dumps(text))
print(len(kept), "pictures")
