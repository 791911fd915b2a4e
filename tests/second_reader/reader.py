"""A second reader of `.mipvog` containers, written from formats/mipvog.md alone.

It shares no code with the crate, so that an agreement of the two shows that the page is enough. It reads strictly: what
the page calls an error raises `Refused`. It is made to be read next to the page, not to be fast.

    python3 reader.py FILE.mipvog OUT.npz                       write every decoded array
    python3 reader.py FILE.mipvog --compare UNPACKED.safetensors  compare with what `mipvog-bake unpack` wrote

Exit status: 0 equal or written, 1 different, 2 refused, 3 a module is missing.
"""

import json
import math
import struct
import sys
import zlib

try:
    import numpy as np

    from chunks import atlas, inflate, mask, network, runs_of
    from description import Refused, blocks_of, coarser_of, encoding_of, is_linear, metadata, need, network_of
except ImportError as error:
    print(f"{error}: pip install -r tests/second_reader/requirements.txt", file=sys.stderr)
    sys.exit(3)

from tables import CHUNKS, FEATURES, GROUPS, MAJOR

NO_LEVEL = 0xFFFFFFFF
KNOWN = CHUNKS + tuple(kind for kind, *_ in GROUPS)


# Sections 2 and 3: header and directory.


def directory(data):
    """The chunks, as (type, level, bytes, prefix, end with padding), after every check that needs no metadata, and
    the required features."""
    need(data[:8] == b"\x89MVG\r\n\x1a\n", "another signature")
    need(len(data) >= 64, "shorter than a header")
    major, _, zero, required, length, start, count, zero2, crc, tail = struct.unpack("<HHIQQQIII12s", data[8:64])
    need(major == MAJOR, f"major version {major}")
    need(required < 1 << len(FEATURES), f"unknown required features {required:#x}")
    need(length == len(data), f"{len(data)} bytes, but the header says {length}")
    need(start == 64, "the directory is not at 64")
    end = 64 + 64 * count
    need(end <= len(data), "the directory goes beyond the file")
    need(zlib.crc32(data[:48] + bytes(4) + data[52:end]) == crc, "checksum of header and directory")
    need(zero == zero2 == 0 and not any(tail), "a reserved field of the header is set")
    chunks = []
    for at in range(64, end, 64):
        kind, level, offset, size, prefix, crc, tail = struct.unpack("<4sIQQQI28s", data[at : at + 64])
        need(kind.isalpha(), f"a chunk's type {kind!r} is not of letters")
        kind = kind.decode("ascii")
        need(not any(tail), f"a reserved field of {kind} is set")
        need(offset == end, f"{kind} does not start right after what is before it")
        end = -(-(offset + size) // 64) * 64
        need(end <= len(data), f"{kind} goes beyond the file")
        body = data[offset : offset + size]
        need(zlib.crc32(body) == crc, f"checksum of {kind}")
        need(not any(data[offset + size : end]), f"padding after {kind}")
        need(kind in KNOWN or kind[0].islower(), f"unknown critical chunk {kind}")
        chunks.append((kind, level, body, prefix, end))
    need(end == len(data), "bytes after the last chunk")
    return chunks, required


def atlases_of(meta, level):
    """The atlases of a level in their order, as (type, name of the array, encoding, channels)."""
    found = [
        (kind, name.replace("_", " "), encoding_of(level, name), channels if type(channels) is int else meta[channels])
        for kind, name, _, _, channels, _ in GROUPS
    ]
    return [atlas for atlas in found if atlas[2] is not None]


def arrange(chunks, required):
    """The metadata, and the bytes of known chunks by type and level, once they are those that the metadata asks for."""
    need(chunks and chunks[0][0] == "META", "the first chunk is not META")
    meta = metadata(chunks[0][2])

    def has(key):
        return any(key in level for level in meta["levels"] + meta.get("shells", []))

    asked = {
        "inherited_blocks": has("blocks_filled"),
        "linear_values": is_linear(meta),
        "bent_rule": "bends" in meta["level_of_detail"],
        "directional": has("directional"),
        "anisotropy": has("anisotropy"),
        "nested_boxes": "shells" in meta,
    }
    bits = sum(asked[name] << bit for bit, name in enumerate(FEATURES))
    need(required == bits, "the required features disagree with the metadata")
    wanted = [("META", NO_LEVEL)]
    wanted += [("VMLP", NO_LEVEL)] * (network_of(meta) is not None) + [("MASK", NO_LEVEL)] * meta["free_space"]
    wanted += [("prov", NO_LEVEL)]
    parts = meta["levels"] + meta.get("shells", [])
    for part in order(meta):
        wanted += [("TABL", part)] + [(kind, part) for kind, *_ in atlases_of(meta, parts[part])]
    known = [chunk for chunk in chunks if chunk[0] in KNOWN and chunk[0] != "thmb"]
    thumbnail([chunk for chunk in chunks if chunk[0] == "thmb"])
    found = [chunk[:2] for chunk in known]
    need(found == wanted, f"chunks {found}, but the metadata asks for {wanted}")
    alone = all(level["density"] is not None for level in parts)
    ends = {level: end for _, level, _, _, end in chunks}  # the last of each level stays
    for kind, level, _, prefix, _ in chunks:
        right = 0 if level == NO_LEVEL else ends[level] if alone else chunks[-1][4]
        need(prefix == right, f"prefix of {kind} {level} is {prefix}, not {right}")
    return meta, {chunk[:2]: chunk[2] for chunk in known}


def thumbnail(chunks):
    """Refuses thumbnails that are no PNG file of 1 to 1024 pixels along each side, or more than one."""
    for kind, level, png, *_ in chunks:
        need(level == NO_LEVEL and len(chunks) == 1, f"{kind} of a level, or more than once")
        need(png[:16] == b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" and len(png) >= 24, "thmb is no PNG file")
        sides = struct.unpack(">II", png[16:24])
        need(all(1 <= side <= 1024 for side in sides), f"thmb of {sides} pixels")


def order(meta):
    """The parts as they stand in a file: coarse to fine, a shell before its level."""
    count, shells = len(meta["levels"]), len(meta.get("shells", []))
    for k in reversed(range(count)):
        if 1 <= k <= shells:
            yield count + k - 1
        yield k


def read(data):
    """Every array of a container, by the names of unpacked files, and its metadata."""
    meta, chunks = arrange(*directory(data))
    out = {}
    if network_of(meta):
        out |= network(chunks["VMLP", NO_LEVEL], meta["view"]["widths"])
    if meta["free_space"]:
        out |= mask(chunks["MASK", NO_LEVEL])
    own = {}
    parts, levels = meta["levels"] + meta.get("shells", []), len(meta["levels"])
    # Coarse to fine: filled blocks are made of the level before.
    for k in order(meta):
        level, blocks = parts[k], blocks_of(parts[k])
        number, wider = coarser_of(meta, k)
        name = f"level{k}" if k < levels else f"shell{number}"
        total = math.prod(blocks)
        if "shells" in meta:
            table = runs_of(chunks["TABL", k], total, f"TABL {k}").reshape(blocks)
        else:
            table = np.frombuffer(inflate(chunks["TABL", k], total, f"TABL {k}"), np.uint8).reshape(blocks)
        need(table.max() <= 2, f"TABL {k}: a byte that is none of 0, 1 and 2")
        need(np.count_nonzero(table) == level["blocks_stored"], f"TABL {k} disagrees with blocks_stored")
        need(np.count_nonzero(table == 2) == level.get("blocks_filled", 0), f"TABL {k} disagrees with blocks_filled")
        out[f"{name}.occupied"] = table
        bands = []
        for kind, key, of, channels in atlases_of(meta, level):
            coarser = None
            if kind not in ("DENS", "ANIS") and level.get("blocks_filled"):
                coarser = own[number + 1, kind], wider
            dense = own[k, kind] = atlas(chunks[kind, k], channels, level, table, of, f"{kind} {k}", coarser)
            if kind.startswith("BND"):
                bands.append(dense)
            else:
                out[f"{name}.{key}"] = dense[0] if kind == "DENS" else dense
        # Unpacked files hold all bands in one array.
        if bands:
            out[f"{name}.features"] = np.concatenate(bands)
    return out, meta


# The script.


def safetensors(data):
    """The arrays of a safetensors file, with no checks: the crate's own tests do those."""
    (length,) = struct.unpack_from("<Q", data)
    types = {"F32": "<f4", "F64": "<f8", "U8": "u1"}
    out = {}
    for name, entry in json.loads(data[8 : 8 + length]).items():
        if name != "__metadata__":
            begin, end = entry["data_offsets"]
            raw = data[8 + length + begin : 8 + length + end]
            out[name] = np.frombuffer(raw, types[entry["dtype"]]).reshape(entry["shape"])
    return out


def difference(ours, theirs):
    """The first difference of two sets of arrays in words, or None."""
    for name in sorted(ours.keys() | theirs.keys()):
        if name not in ours or name not in theirs:
            return f"{name} is only in {'this reading' if name in ours else 'the unpacked file'}"
        a, b = np.ascontiguousarray(ours[name]), np.ascontiguousarray(theirs[name])
        if a.dtype != b.dtype or a.shape != b.shape:
            return f"{name}: {a.dtype} {a.shape} here, {b.dtype} {b.shape} there"
        bits = np.dtype(f"u{a.itemsize}")  # so that -0 is not 0, and a NaN is itself
        wrong = np.argwhere(a.view(bits) != b.view(bits))
        if len(wrong):
            at = tuple(wrong[0])
            return f"{name}{[int(i) for i in at]}: {a[at]!r} here, {b[at]!r} there ({len(wrong)} differ)"
    return None


def main(arguments):
    if len(arguments) not in (2, 3) or (len(arguments) == 3) != (arguments[1] == "--compare"):
        print(__doc__, file=sys.stderr)
        return 2
    with open(arguments[0], "rb") as file:
        data = file.read()
    try:
        arrays, meta = read(data)
    except (Refused, MemoryError) as error:
        print(f"{arguments[0]}: refused: {error}")
        return 2
    said = f"{len(meta['levels'])} levels, {len(arrays)} arrays"
    if len(arguments) == 2:
        np.savez(arguments[1], **arrays)
        print(f"{arguments[0]}: {said}")
        return 0
    with open(arguments[2], "rb") as file:
        found = difference(arrays, safetensors(file.read()))
    print(f"{arguments[0]}: {found or said + ', all bits equal'}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
