"""Opens a stage with OpenUSD's own library: python check.py SCENE.usda GRID...

Its volume has these grids and no others, each of a file that is there, and no validator of the
library finds anything.
"""

import sys
from pathlib import Path

try:
    from pxr import Usd, UsdGeom, UsdValidation, UsdVol
except ImportError as error:
    print(f"{error}: pip install -r tests/usd/requirements.txt")
    sys.exit(3)

_, path, *names = sys.argv
stage = Usd.Stage.Open(path)
volume = UsdVol.Volume(stage.GetDefaultPrim())
assert volume, "the default prim is no volume"
low, high = UsdGeom.Boundable(volume).GetExtentAttr().Get()
assert all(a < b for a, b in zip(low, high, strict=True)), (low, high)
fields = {name: stage.GetPrimAtPath(place) for name, place in volume.GetFieldPaths().items()}
assert set(fields) == set(names), fields
for name, prim in fields.items():
    asset = UsdVol.OpenVDBAsset(prim)
    assert asset and asset.GetFieldNameAttr().Get() == name, name
    file = asset.GetFilePathAttr().Get().resolvedPath
    assert Path(file).samefile(Path(path).with_suffix(".vdb")), file
validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
findings = UsdValidation.ValidationContext(validators).Validate(stage)
assert validators and not findings, [finding.GetErrorAsString() for finding in findings]
print(UsdGeom.GetStageUpAxis(stage))
