"""Throughput of a catalogue on Ray against a plain loop on the same cores.

    pip install "./python[ray]"
    python benches/catalogue.py [SCENES] [INPUT]

bakes the scenes in turns: by Ray, and by one `bake --manifest --shard` a core. A warm-up of Ray is
not counted, because a cluster runs already.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import ray
from mipvog_bake.ray import Options, bake_all, program

ROOT = Path(__file__).resolve().parents[1]

TURNS = 3


def main() -> None:
    scenes = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    source = sys.argv[2] if len(sys.argv) > 2 else ROOT / "fixtures/trained/lego64/fine_last.tar"
    cores = os.cpu_count() or 1
    tool = program.find(None)
    ray.init(num_cpus=cores, log_to_driver=False, logging_level="ERROR")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        manifest = folder / "scenes.jsonl"
        line = {"input": str(Path(source).resolve()), "options": {"stepsize": 0.5}}
        manifest.write_text(
            "".join(json.dumps(line | {"output": f"{n}.mipvog"}) + "\n" for n in range(scenes))
        )
        few = folder / "few.jsonl"
        few.write_text("".join(manifest.read_text().splitlines(keepends=True)[: 2 * cores]))
        bake_all(Options(str(few), str(folder / "warm")), lambda result: None)
        for turn in range(TURNS):
            clock = time.perf_counter()
            failed = bake_all(Options(str(manifest), str(folder / f"ray{turn}")), lambda r: None)
            on_ray = time.perf_counter() - clock
            clock = time.perf_counter()
            arguments = [tool, "bake", "--manifest", str(manifest), "--threads=1", "--quiet"]
            arguments += ["-o", str(folder / f"loop{turn}")]
            shards = [
                subprocess.Popen([*arguments, "--shard", f"{n}/{cores}"], stdout=subprocess.DEVNULL)
                for n in range(cores)
            ]
            assert failed == 0 and not any(shard.wait() for shard in shards)
            loop = time.perf_counter() - clock
            print(f"{scenes} scenes, {cores} cores: Ray {on_ray:.2f} s, loop {loop:.2f} s, "
                  f"ratio {on_ray / loop:.3f}")


if __name__ == "__main__":
    main()
