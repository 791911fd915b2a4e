"""Makes fixtures/vdb/: one small fog volume, as OpenVDB's own library writes it.

Needs Debian's python3-openvdb and libopenvdb-tools, whose vdb_tool writes the NanoVDB files. The voxels follow from formulas in whole numbers, which
tests/program/vdb.rs has too. Voxel (x, y, z) of 20 x 12 x 9 from (-5, 0, 3) on is active where x + y
+ z is no multiple of 3; density is ((7 x + 5 y + 3 z) mod 64 + 1) / 16, Cd is ((x mod 8) / 8, (y
mod 4) / 4, 0.5). The grids `density` have a tile of 8 x 8 x 8 voxels of 2.5 from (32, 0, 0) on.
"""

import subprocess
import sys

import pyopenvdb as vdb

folder = sys.argv[1]


def density(x, y, z):
    return ((7 * x + 5 * y + 3 * z) % 64 + 1) / 16


def grids(half):
    fog, color = vdb.FloatGrid(), vdb.Vec3SGrid()
    fog.name, color.name = "density", "Cd"
    fog.gridClass = vdb.GridClass.FOG_VOLUME
    fog_at, color_at = fog.getAccessor(), color.getAccessor()
    for x in range(-5, 15):
        for y in range(12):
            for z in range(3, 12):
                if (x + y + z) % 3:
                    fog_at.setValueOn((x, y, z), density(x, y, z))
                    color_at.setValueOn((x, y, z), (x % 8 / 8, y % 4 / 4, 0.5))
    fog.fill((32, 0, 0), (39, 7, 7), 2.5)
    fog.prune()
    matrix = [[0.25, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 0.125, 0], [1, -2, 0.5, 1]]
    for grid in (fog, color):
        grid.transform = vdb.createLinearTransform(matrix)
        grid.saveFloatAsHalf = half
    return [fog, color]


vdb.write(f"{folder}/full.vdb", grids=grids(False))
vdb.write(f"{folder}/half.vdb", grids=grids(True))
vdb.write(f"{folder}/white.vdb", grids=grids(False)[:1])
turned = grids(False)[:1]
turned[0].transform = vdb.createLinearTransform(
    [[0.6, 0.8, 0, 0], [-0.8, 0.6, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
)
vdb.write(f"{folder}/turned.vdb", grids=turned)
shape = vdb.FloatGrid()
shape.name = "surface"
vdb.write(f"{folder}/surface.vdb", grids=[shape])
for name, settings in {
    "float": ["codec=zip"],
    "blosc": ["codec=blosc"],
    "fp16": ["bits=16", "codec=zip"],
    "fp8": ["bits=8", "codec=zip"],
    "fp4": ["bits=4", "codec=zip"],
    "fpn": ["bits=N", "tolerance=0.01", "codec=zip"],
}.items():
    line = ["vdb_tool", "-read", f"{folder}/full.vdb", "-write", *settings, f"{folder}/{name}.nvdb"]
    subprocess.run(line, check=True)
