"""The memory of Ray's driver for a manifest whose inputs are all missing.

    pip install "./python[ray]"
    python benches/long_manifest.py [SCENES]

Each scene fails at once, so that the driver has the most to do. The report is read back: it has a
line for each scene.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RUN = """
import sys
from mipvog_bake.ray.__main__ import main
code = main(sys.argv[1:])
lines = open("/proc/self/status").read().splitlines()
print(code, next(line.split()[1] for line in lines if line.startswith("VmHWM")))
"""


def main() -> None:
    scenes = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        manifest, report = folder / "scenes.jsonl", folder / "report.jsonl"
        with manifest.open("w", encoding="utf-8") as file:
            for number in range(scenes):
                scene = {"input": f"{number}.tar", "output": f"{number}.mipvog"}
                file.write(json.dumps(scene) + "\n")
        words = [str(manifest), "-o", str(folder / "out"), "--report", str(report)]
        clock = time.perf_counter()
        ended = subprocess.run(
            [sys.executable, "-c", RUN, *words], capture_output=True, encoding="utf-8", check=True
        )
        seconds = time.perf_counter() - clock
        code, peak = map(int, ended.stdout.split()[-2:])
        with report.open(encoding="utf-8") as file:
            results = [json.loads(line) for line in file]
        outputs = {result["output"] for result in results}
        codes = {result["exit_code"] for result in results}
        assert code == 1 and codes == {5} and len(results) == len(outputs) == scenes
        print(f"{scenes} scenes, {len(results)} results: {seconds:.1f} s, "
              f"driver {peak * 1024 / 1e6:.0f} MB at its peak")


if __name__ == "__main__":
    main()
