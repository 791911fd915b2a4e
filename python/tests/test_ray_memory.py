"""The memory of the driver, which may hold the names of scenes and nothing else that grows."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("ray")
pytest.importorskip("fsspec")

from mipvog_bake.ray import program  # noqa: E402
from mipvog_bake.ray.failure import Failure  # noqa: E402

try:
    program.find(None)
except Failure:
    pytest.skip("no program mipvog-bake here", allow_module_level=True)

# The first starts the cluster; the others are compared.
FIRST, FEW, MANY = 100, 1_000, 6_000
# Runs manifests on one cluster; tells after each the bytes of the process at its peak, and those
# that Python held at its peak beyond those before.
SCRIPT = """
import gc, json, sys, tracemalloc
from mipvog_bake.ray.__main__ import main
def peak():
    lines = open("/proc/self/status").read().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
tracemalloc.start()
for manifest in sys.argv[1:]:
    gc.collect()
    tracemalloc.reset_peak()
    before = tracemalloc.get_traced_memory()[0]
    code = main([manifest, "-o", manifest + ".out", "--report", manifest + ".report"])
    print(json.dumps([code, peak(), tracemalloc.get_traced_memory()[1] - before]))
"""


def missing(folder: Path, count: int) -> Path:
    """A manifest of inputs that are not there."""
    path = folder / f"{count}.jsonl"
    scenes = ({"input": f"{n}.tar", "output": f"{n}.mipvog"} for n in range(count))
    path.write_text("".join(json.dumps(scene) + "\n" for scene in scenes), encoding="utf-8")
    return path


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="no /proc")
def test_the_driver_holds_no_more_than_names(tmp_path: Path) -> None:
    manifests = [missing(tmp_path, count) for count in (FIRST, FEW, MANY)]
    words = [sys.executable, "-c", SCRIPT, *map(str, manifests)]
    ended = subprocess.run(words, capture_output=True, encoding="utf-8", check=False)
    assert ended.returncode == 0, ended.stderr
    told = [json.loads(line) for line in ended.stdout.splitlines() if line.startswith("[")]
    assert [code for code, _, _ in told] == [1, 1, 1]
    # A set of names: their texts, and a table that doubles.
    names = [{f"{n}.mipvog" for n in range(count)} for count in (FEW, MANY)]
    small, large = (sys.getsizeof(one) + sum(map(sys.getsizeof, one)) for one in names)
    assert told[2][2] - told[1][2] < 1.5 * (large - small)
    assert told[2][1] < 500_000_000

    for manifest, count in zip(manifests, (FIRST, FEW, MANY), strict=True):
        lines = Path(f"{manifest}.report").read_text(encoding="utf-8").splitlines()
        results = [json.loads(line) for line in lines]
        assert {result["exit_code"] for result in results} == {5}
        assert len(lines) == len({result["output"] for result in results}) == count
        assert f"{count} scenes: 0 baked, 0 unchanged, {count} failed" in ended.stdout
