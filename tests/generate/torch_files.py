"""Writes files as torch.save does, without PyTorch: the classes below pickle to the names that
PyTorch's own would.
"""
import collections, io, os, pickle, sys, types, zipfile
import numpy as np

OUT = "fixtures/trained"
torch = types.ModuleType("torch")
torch._utils = types.ModuleType("torch._utils")
sys.modules["torch"], sys.modules["torch._utils"] = torch, torch._utils


def publish(module, name, thing):
    thing.__module__, thing.__qualname__, thing.__name__ = module.__name__, name, name
    setattr(module, name, thing)
    return thing


for name in ["Float", "Double", "Half", "BFloat16", "Bool", "Long", "Char"]:
    publish(torch, name + "Storage", type(name + "Storage", (), {}))
publish(torch, "UntypedStorage", type("UntypedStorage", (), {}))
rebuild2 = publish(torch._utils, "_rebuild_tensor_v2", lambda *a: a)
rebuild3 = publish(torch._utils, "_rebuild_tensor_v3", lambda *a: a)
parameter = publish(torch._utils, "_rebuild_parameter", lambda *a: a)


class ElementType:
    def __init__(self, name):
        self.name, self.__module__ = name, "torch"
        setattr(torch, name, self)

    def __reduce__(self):
        return self.name


float32 = ElementType("float32")
STORAGES = {"f4": "Float", "f8": "Double", "f2": "Half", "b1": "Bool", "i8": "Long", "i1": "Char", "bf": "BFloat16"}


class Storage:
    def __init__(self, data, kind, untyped=False):
        self.data, self.kind, self.untyped = data, kind, untyped
        self.size = 2 if kind == "bf" else np.dtype(kind).itemsize


class Tensor:
    """A tensor over a storage of its own, or a strided view of another."""

    def __init__(self, array, kind=None, untyped=False, as_parameter=False):
        array = np.asarray(array)
        self.kind = kind or array.dtype.str[1:]
        self.as_parameter = as_parameter
        data = bfloat16(array) if self.kind == "bf" else np.ascontiguousarray(array.astype(self.kind)).tobytes()
        self.storage, self.first = Storage(data, self.kind, untyped), 0
        self.shape = array.shape
        self.strides = tuple(int(np.prod(array.shape[i + 1:], dtype=int)) for i in range(array.ndim))

    def __reduce_ex__(self, protocol):
        common = (self.storage, self.first, self.shape, self.strides, False, collections.OrderedDict())
        if self.storage.untyped:
            return rebuild3, common + (float32,)
        if self.as_parameter:
            plain = Tensor.__new__(Tensor)
            plain.__dict__.update(self.__dict__, as_parameter=False)
            return parameter, (plain, True, collections.OrderedDict())
        return rebuild2, common


def bfloat16(array):
    return (np.ascontiguousarray(array, np.float32).view(np.uint32) >> 16).astype(np.uint16).tobytes()


class Pickler(pickle.Pickler):
    def __init__(self, out, protocol):
        super().__init__(out, protocol)
        self.storages = []

    def persistent_id(self, thing):
        if not isinstance(thing, Storage):
            return None
        if thing not in self.storages:
            self.storages.append(thing)
        key = str(self.storages.index(thing))
        kind = torch.UntypedStorage if thing.untyped else getattr(torch, STORAGES[thing.kind] + "Storage")
        count = len(thing.data) if thing.untyped else len(thing.data) // thing.size
        return "storage", kind, key, "cpu", count


def write_zip(path, entries, method=zipfile.ZIP_STORED):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in entries:
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type = method
            archive.writestr(entry, data)


def save(path, value, protocol=2, root="archive", method=zipfile.ZIP_STORED, order=b"little"):
    out = io.BytesIO()
    pickler = Pickler(out, protocol)
    pickler.dump(value)
    entries = [(f"{root}/data.pkl", out.getvalue()), (f"{root}/byteorder", order)]
    entries += [(f"{root}/data/{i}", s.data) for i, s in enumerate(pickler.storages)]
    write_zip(f"{OUT}/{path}", entries + [(f"{root}/version", b"3\n")], method)
