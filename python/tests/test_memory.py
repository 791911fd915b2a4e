"""Arrays are read where they lie."""

import subprocess
import sys

BAKE = """
import sys, numpy as np, mipvog_bake
def peak():
    lines = open("/proc/self/status").read().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
density = np.full((192, 192, 192), -8, dtype=np.float32)
density[60:130, 60:130, 60:130] = 8
diffuse = np.ones((3, 192, 192, 192), dtype=np.float32)
field = mipvog_bake.from_arrays(density, diffuse=diffuse, bounds=((-1,) * 3, (1,) * 3))
before = peak()
mipvog_bake.bake(field, sys.argv[1])
print((peak() - before) / (density.nbytes + diffuse.nbytes))
"""


def test_no_array_is_copied(tmp_path):
    words = [sys.executable, "-c", BAKE, tmp_path / "box.mipvog"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 0.5
