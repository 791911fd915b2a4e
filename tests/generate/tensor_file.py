"""Reads and writes safetensors files of float32 arrays."""
import json, struct
import numpy as np


def write(path, arrays):
    header, data = {}, b""
    for name, array in sorted(arrays.items()):
        raw = np.ascontiguousarray(array, np.float32).tobytes()
        offsets = [len(data), len(data) + len(raw)]
        header[name] = {"dtype": "F32", "shape": list(np.shape(array)), "data_offsets": offsets}
        data += raw
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    with open(path, "wb") as out:
        out.write(struct.pack("<Q", len(text)) + text + data)


def read(path):
    data = open(path, "rb").read()
    end = 8 + struct.unpack("<Q", data[:8])[0]
    arrays = {}
    for name, entry in json.loads(data[8:end]).items():
        if name != "__metadata__":
            start, stop = (end + offset for offset in entry["data_offsets"])
            arrays[name] = np.frombuffer(data[start:stop], np.float32).reshape(entry["shape"])
    return arrays
