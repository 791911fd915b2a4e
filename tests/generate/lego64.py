"""Writes fixtures/trained/lego64: a trained scene without what no bake reads.

    python3 tests/generate/lego64.py FOLDER_OF_THE_TRAINED_SCENE

Takes `fine_last.tar` and `coarse_last.tar` as training wrote them. Leaves out the surface cache and
the optimizer, and of the coarse checkpoint everything but the settings of the free-space mask.
Values are copied bit for bit. Python 3.11 and NumPy 2, from the repository's root.
"""
import collections, io, pickle, sys, zipfile
import numpy as np
from torch_files import Tensor, save

KINDS = {"FloatStorage": np.float32, "BoolStorage": np.bool_, "LongStorage": np.int64}


def load(path):
    archive = zipfile.ZipFile(path)
    root = next(name for name in archive.namelist() if name.endswith("data.pkl"))[:-8]

    class Unpickler(pickle.Unpickler):
        def persistent_load(self, pid):
            return np.frombuffer(archive.read(f"{root}data/{pid[2]}"), dtype=KINDS[pid[1]])

        def find_class(self, module, name):
            if name in KINDS:
                return name
            if name == "_rebuild_tensor_v2":
                return lambda data, first, size, stride, *rest: Tensor(
                    data[first : first + int(np.prod(size))].reshape(size)
                )
            if name == "OrderedDict":
                return collections.OrderedDict
            if module.startswith("numpy") or module == "_codecs":
                return super().find_class(module.replace("numpy._core", "numpy.core"), name)
            raise pickle.UnpicklingError(f"{module}.{name}")

    return Unpickler(io.BytesIO(archive.read(f"{root}data.pkl"))).load()


folder = sys.argv[1]
fine = load(f"{folder}/fine_last.tar")
fine.pop("optimizer_state_dict")
for name in [name for name in fine["model_state_dict"] if name.startswith("surf_cache")]:
    fine["model_state_dict"].pop(name)
fine["model_kwargs"]["mask_cache_path"] = "coarse_last.tar"
save("lego64/fine_last.tar", fine, root="fine_last")
coarse = load(f"{folder}/coarse_last.tar")
save("lego64/coarse_last.tar", {"MaskCache_kwargs": coarse["MaskCache_kwargs"]}, root="coarse_last")
