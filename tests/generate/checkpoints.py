"""Writes the small checkpoints under fixtures/trained/dvgo and fixtures/trained/hostile.

Run with Python 3.11 and NumPy 2 from the repository's root. Values are multiples of 1/8 in
[-4, 4), so float16 and bfloat16 hold them exactly and every variant must read the same.
"""
import collections, io, json, os, pickle, struct, sys, types, zipfile, zlib
import numpy as np
from torch_files import *

def values(*shape, seed=1):
    count = int(np.prod(shape))
    mixed = (np.arange(count, dtype=np.uint64) + np.uint64(seed * 7919)) * np.uint64(2654435761)
    return (((mixed >> np.uint64(7)) & np.uint64(63)).astype(np.float32) / 8 - 4).reshape(shape)


NODES = (9, 7, 5)
MIN, MAX = np.array([-1, -2, -0.5], np.float32), np.array([1.5, 1, 0.75], np.float32)
MASK = values(4, 3, 2, seed=5) > -2
MASK_SCALE = (np.array([4, 3, 2], np.float32) - 1) / (MAX - MIN)
LAYERS = {"rgbnet.0": (16, 34), "rgbnet.2.0": (16, 16), "rgbnet.3": (3, 16)}


def kwargs():
    """Settings as DirectVoxGO stores them: Python's, NumPy's, arrays without axes."""
    return {
        "xyz_min": MIN, "xyz_max": MAX, "num_voxels": 300, "num_voxels_base": np.int64(2400),
        "alpha_init": 1e-2, "mask_cache_path": None, "mask_cache_thres": 1e-3,
        "mask_cache_world_size": [4, 3, 2], "fast_color_thres": np.float32(2 ** -10),
        "density_type": "DenseGrid", "k0_type": "DenseGrid", "density_config": {}, "k0_config": {},
        "rgbnet_dim": 7, "rgbnet_direct": np.bool_(True), "rgbnet_full_implicit": False,
        "rgbnet_depth": 3, "rgbnet_width": 16, "viewbase_pe": np.array(4), "empty": np.zeros(0, np.float32),
    }


def state(channels=7, nodes=NODES):
    weights = {
        "xyz_min": MIN, "xyz_max": MAX, "viewfreq": 2.0 ** np.arange(4, dtype=np.float32),
        "act_shift": np.array([-6.5], np.float32), "density.grid": values(1, 1, *nodes),
        "k0.grid": values(1, channels, *nodes, seed=2), "mask_cache.mask": MASK,
        "mask_cache.xyz2ijk_scale": MASK_SCALE, "mask_cache.xyz2ijk_shift": -MIN * MASK_SCALE,
    }
    for index, (name, shape) in enumerate(LAYERS.items()):
        weights[name + ".weight"] = values(*shape, seed=10 + index)
        weights[name + ".bias"] = values(shape[0], seed=20 + index)
    return weights


def tensors(weights, grids=None, **how):
    out = collections.OrderedDict()
    for name, array in weights.items():
        is_grid = array.ndim == 5
        out[name] = Tensor(array, grids if is_grid else None, as_parameter=is_grid and not how, **how)
    out._metadata = collections.OrderedDict([("", {"version": 1})])
    return out


def optimizer():
    return {"state": {0: {"step": 100, "exp_avg": Tensor(np.zeros(9 * 7 * 5, np.float32))}},
            "param_groups": [{"lr": 0.1, "betas": (0.9, 0.99), "params": [0]}]}


def checkpoint(weights, **settings):
    return {"global_step": 20000, "model_kwargs": {**kwargs(), **settings},
            "model_state_dict": weights, "optimizer_state_dict": optimizer()}


# DirectVoxGO, new generation, in every spelling.
for protocol in (2, 3, 4, 5):
    save(f"dvgo/protocol{protocol}.tar", checkpoint(tensors(state())), protocol)
save("dvgo/float16.tar", checkpoint(tensors(state(), "f2")))
save("dvgo/bfloat16.tar", checkpoint(tensors(state(), "bf")))
save("dvgo/float64.tar", checkpoint(tensors(state(), "f8")))
save("dvgo/deflated.tar", checkpoint(tensors(state())), method=zipfile.ZIP_DEFLATED)
floats = {k: v for k, v in state().items() if v.dtype != bool}
untyped = tensors(floats, untyped=True)
untyped["mask_cache.mask"] = Tensor(MASK)
save("dvgo/untyped.tar", checkpoint(untyped))
strided = tensors(state())
one = strided["k0.grid"]
backwards = np.ascontiguousarray(np.moveaxis(state()["k0.grid"][0], 0, -1))
one.storage, one.first = Storage(b"\xff" * 12 + backwards.tobytes(), "f4"), 3
one.strides = (1, 1, 7 * 5 * 7, 5 * 7, 7)
save("dvgo/strided.tar", checkpoint(strided))

# The same under the old names, with a mask of density and the coarse checkpoint beside it.
RENAMED = {"density.grid": "density", "k0.grid": "k0"}
old = {RENAMED.get(k, k): v for k, v in state().items()}
for key in ["act_shift", "mask_cache.mask", "mask_cache.xyz2ijk_scale", "mask_cache.xyz2ijk_shift"]:
    del old[key]
old["mask_cache.density"] = values(1, 1, 4, 3, 2, seed=6)
old["mask_cache.xyz_min"], old["mask_cache.xyz_max"] = MIN - 1, MAX + 1
for folder in ("old", "orphan"):
    save(f"{folder}/fine_last.tar", checkpoint(tensors(old), mask_cache_path="./logs/lego/coarse_last.tar"))
save("old/coarse_last.tar", {
    "model_kwargs": {"alpha_init": 1e-6}, "model_state_dict": tensors({"density": values(1, 1, 4, 3, 2)}),
    "MaskCache_kwargs": {"act_shift": np.log(1 / (1 - 1e-4) - 1), "voxel_size_ratio": Tensor(np.float32(2)),
                         "nearest": False}})

# Flat files.
flat = {**{f"model_state_dict.{k}": v for k, v in state().items()},
        **{f"model_kwargs.{k}": np.asarray(kwargs()[k]) for k in ("num_voxels", "num_voxels_base", "fast_color_thres")},
        "model_kwargs.density_type": np.asarray("DenseGrid")}


def npz(path, arrays, method=zipfile.ZIP_STORED):
    entries = []
    for name, array in arrays.items():
        out = io.BytesIO()
        np.lib.format.write_array(out, array)
        entries.append((name + ".npy", out.getvalue()))
    write_zip(f"{OUT}/{path}", entries, method)


def safetensors(path, arrays, metadata, kinds={}):
    header, data = {"__metadata__": metadata}, b""
    for name, array in arrays.items():
        raw = bfloat16(array) if kinds.get(name) == "BF16" else np.ascontiguousarray(array).tobytes()
        code = kinds.get(name) or {"f4": "F32", "b1": "BOOL", "f2": "F16", "i8": "I64"}[array.dtype.str[1:]]
        header[name] = {"dtype": code, "shape": list(array.shape), "data_offsets": [len(data), len(data) + len(raw)]}
        data += raw
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    with open(f"{OUT}/{path}", "wb") as out:
        out.write(struct.pack("<Q", len(text)) + text + data)


npz("dvgo/flat.npz", flat)
npz("dvgo/flat_compressed.npz", flat, zipfile.ZIP_DEFLATED)
npz("dvgo/flat_fortran.npz", {k: np.asfortranarray(v) for k, v in flat.items()})
texts = {"num_voxels": "300", "model_kwargs.num_voxels_base": "2400", "fast_color_thres": repr(2.0 ** -10),
         "rgbnet_direct": "True", "mask_cache_path": "None", "comment": "made by tests/generate/checkpoints.py"}
safetensors("dvgo/flat.safetensors", state(), texts)
safetensors("dvgo/flat_bfloat16.safetensors", state(), texts, {"density.grid": "BF16", "k0.grid": "BF16"})

# Models that cannot be baked.
weights = state(12)
weights["rgbnet.0.weight"] = values(16, 39)
save("refused/per_sample.tar", checkpoint(tensors(weights), rgbnet_dim=12))
save("refused/contracted.tar", checkpoint(tensors({**state(), "scene_center": MIN}), bg_len=0.2))
save("refused/multiplane.tar", checkpoint(tensors({**state(), "act_shift.grid": values(1, 1, 1, 1, 5)}), mpi_depth=5))
save("refused/nearest.tar", checkpoint(tensors(state()), nearest=True))
save("refused/diffuse.tar", checkpoint(tensors({k: v for k, v in state().items() if "rgbnet" not in k})))
save("refused/two_channels.tar", checkpoint(tensors(state(2))))
save("refused/zero_axis.tar", checkpoint(tensors(state(nodes=(9, 0, 5)))))
save("refused/sizes_differ.tar", checkpoint(tensors({**state(), "k0.grid": values(1, 7, 9, 7, 6)})))
save("refused/big_endian.tar", checkpoint(tensors(state())), order=b"big")
npz("refused/big_endian.npz", {"density": values(4, 3, 2).astype(">f4")})
npz("refused/structured.npz", {"density": np.zeros(3, [("a", "<f4"), ("b", "<i4")])})

# Files that mean harm.
def hostile(name, program, storages=((0, b"\0" * 16),)):
    entries = [("archive/data.pkl", program)] + [(f"archive/data/{k}", d) for k, d in storages]
    write_zip(f"{OUT}/hostile/{name}.tar", entries)


def text(value):
    return b"X" + struct.pack("<I", len(value)) + value.encode()


def tensor(count, shape, strides, first=0):
    """The pickle of a tensor over storage 0 with numbers of any size."""
    def number(value):
        return b"\x8a\x08" + struct.pack("<q", value)
    storage = b"(" + text("storage") + b"ctorch\nFloatStorage\n" + text("0") + text("cpu") + number(count) + b"tQ"
    sizes = b"(" + b"".join(map(number, shape)) + b"t(" + b"".join(map(number, strides)) + b"t"
    return b"ctorch._utils\n_rebuild_tensor_v2\n(" + storage + number(first) + sizes + b"\x89}tR"


hostile("os_system", b"\x80\x02cos\nsystem\n" + text("touch hacked") + b"\x85R.")
hostile("eval", b"\x80\x04\x8c\x08builtins\x8c\x04eval\x93\x8c\x031+1\x85R.")
hostile("holds_itself", b"\x80\x02}q\x00" + text("model_state_dict") + b"h\x00s.")
laughs = b"\x80\x02]q\x00" + b"".join(b"]q" + bytes([i + 1]) + b"(" + (b"h" + bytes([i])) * 10 + b"e" for i in range(30))
hostile("laughs", laughs + b".")
hostile("long_laughs", b"\x80\x02" + text("ha" * 5000) + b"q\x00]q\x01(" + b"h\x00" * 60000 + b"e.")
# Copies of a long tuple, dropped at once: each `torch.Size` is one.
sizes = b"\x80\x02(" + b"N" * 10000 + b"tq\x00ctorch\nSize\nq\x01" + b"h\x01h\x00\x85R0" * 1000 + b"}."
hostile("sizes", sizes)
hostile("deep", b"\x80\x02" + b"]" * 50000 + b"a" * 49999 + b".")
hostile("huge_storage", b"\x80\x02" + tensor(1 << 62, [4], [1]) + b".")
hostile("huge_shape", b"\x80\x02" + tensor(4, [1 << 31, 1 << 31, 1 << 31], [1, 1, 1]) + b".")
hostile("huge_stride", b"\x80\x02" + tensor(4, [2, 2], [1 << 62, 1 << 62]) + b".")
hostile("beyond", b"\x80\x02" + tensor(4, [4], [1], 1) + b".")
hostile("negative", b"\x80\x02" + tensor(4, [-4], [1]) + b".")
hostile("no_storage", b"\x80\x02" + tensor(4, [4], [1]) + b".", ())
hostile("huge_bytes", b"\x80\x02\x8e" + struct.pack("<Q", 1 << 62) + b".")
write_zip(f"{OUT}/hostile/bomb.tar", [("archive/data.pkl", b"\x80\x02" + b"N0" * (40 << 20) + b"N.")], zipfile.ZIP_DEFLATED)
# Entries that state another inflated size than they have: patched in both headers.
def restate(path, length):
    data = bytearray(open(path, "rb").read())
    data[22:26] = struct.pack("<I", length)
    at = data.index(b"PK\x01\x02")
    data[at + 24:at + 28] = struct.pack("<I", length)
    open(path, "wb").write(data)


write_zip(f"{OUT}/hostile/states_less.tar", [("archive/data.pkl", b"\x80\x02" + b"N0" * 5000 + b"N.")], zipfile.ZIP_DEFLATED)
restate(f"{OUT}/hostile/states_less.tar", 100)
write_zip(f"{OUT}/hostile/states_more.tar", [("archive/data.pkl", b"\x80\x02N.")], zipfile.ZIP_DEFLATED)
restate(f"{OUT}/hostile/states_more.tar", 0xFFFFFFF0)
import warnings
warnings.simplefilter("ignore")
write_zip(f"{OUT}/hostile/duplicate.tar", [("archive/data.pkl", b"\x80\x02N."), ("archive/data.pkl", b"\x80\x02N.")])
whole = open(f"{OUT}/dvgo/protocol2.tar", "rb").read()
at = whole.index(values(1, 7, *NODES, seed=2).tobytes())
damaged = bytearray(whole)
damaged[whole.index(values(16, 34, seed=10).tobytes()) + 5] ^= 0x40
for name, data in {"truncated.tar": whole[:-30], "half.tar": whole[:len(whole) // 2], "damaged_weight.tar": bytes(damaged),
                   "empty": b"", "text.txt": b"Not a checkpoint.\n", "empty.zip": b"PK\x05\x06" + b"\0" * 18,
                   "legacy.pt": b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03."}.items():
    open(f"{OUT}/hostile/{name}", "wb").write(data)


def header(name, fields, data=b"\0" * 16, length=None):
    raw = fields if isinstance(fields, bytes) else json.dumps(fields).encode()
    with open(f"{OUT}/hostile/{name}.safetensors", "wb") as out:
        out.write(struct.pack("<Q", len(raw) if length is None else length) + raw + data)


def described(shape, start, end, dtype="F32"):
    return {"dtype": dtype, "shape": shape, "data_offsets": [start, end]}


header("huge_header", {"a": described([4], 0, 16)}, length=1 << 62)
header("twice", b'{"a":{"dtype":"F32","shape":[4],"data_offsets":[0,16]},"a":{"dtype":"F32","shape":[4],"data_offsets":[0,16]}}')
header("hole", {"a": described([1], 0, 4), "b": described([2], 8, 16)})
header("overlap", {"a": described([2], 0, 8), "b": described([3], 4, 16)})
header("outside", {"a": described([8], 0, 32)})
header("slack", {"a": described([2], 0, 8)})
header("other_size", {"a": described([3], 0, 16)})
header("overflow", {"a": described([1 << 62, 1 << 62], 0, 16)})
header("foreign_type", {"a": described([16], 0, 16, "F8_E4M3")})
header("deep", b'{"a":' + b"[" * 5000 + b"]" * 5000 + b"}")
