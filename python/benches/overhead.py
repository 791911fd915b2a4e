"""What the module adds to the program: bakes of both in turn, and the memory of each.

python overhead.py target/release/mipvog-bake fine_last.tar --stepsize=0.5 --near=2 --far=6
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROUNDS = 25
ALONE = """
import json, sys, mipvog_bake
def peak():
    lines = open("/proc/self/status").read().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
before = peak()
mipvog_bake.bake(sys.argv[1], sys.argv[2], force=True, **json.loads(sys.argv[3]))
print(peak() - before)
"""


def main(program, scene, *words):
    import mipvog_bake

    options = dict(word.removeprefix("--").split("=") for word in words)
    output = str(Path(tempfile.mkdtemp()) / "scene.mipvog")
    command = [program, "bake", scene, "-o", output, "--force", "--format=json", "--quiet", *words]
    mipvog_bake.bake(scene, output, **options)
    times = {"program": [], "module": []}
    for _ in range(ROUNDS):
        clock = time.perf_counter()
        report = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
        times["program"].append(time.perf_counter() - clock)
        clock = time.perf_counter()
        mipvog_bake.bake(scene, output, force=True, **options)
        times["module"].append(time.perf_counter() - clock)
    pairs = [module - own for own, module in zip(*times.values(), strict=True)]
    for name, seconds in times.items():
        print(f"{name}: {1e3 * statistics.median(seconds):.0f} ms")
    ratios = [module / own for own, module in zip(*times.values(), strict=True)]
    print(f"module beyond program: {1e3 * statistics.median(pairs):.0f} ms, median of pairs")
    print(f"module to program: {statistics.median(ratios):.3f}, median of pairs")
    words = [sys.executable, "-c", ALONE, scene, output, json.dumps(options)]
    alone = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    print(
        f"peak memory: program {report['peak_memory_bytes']}, module beyond Python's {alone}",
        end="",
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
