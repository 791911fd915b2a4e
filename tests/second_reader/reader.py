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
    import zstandard
except ImportError as error:
    print(f"{error}: pip install -r tests/second_reader/requirements.txt", file=sys.stderr)
    sys.exit(3)

from tables import CHUNKS, FEATURES, GROUPS, MAJOR, OBJECTS

NO_LEVEL = 0xFFFFFFFF
KNOWN = CHUNKS + tuple(kind for kind, *_ in GROUPS)
# Number type: bytes of a code, prediction of a block's first node, allowed bits, the float it orders.
NUMBERS = {
    "u8": (1, 0, range(1, 9), None),
    "u16": (2, 0, range(9, 17), None),
    "f16": (2, 1 << 15, (16,), np.float16),
    "f32": (4, 1 << 31, (32,), np.float32),
}


class Refused(Exception):
    """The file is not a container that this reader may accept."""


def need(truth, message):
    if not truth:
        raise Refused(message)


# Section 4: metadata. `tables.py` says what a form is.


def f32(value, wanted):
    need(type(value) in (int, float) and math.isfinite(value), f"{value!r} is no finite number")
    need(abs(value) <= np.finfo(np.float32).max and float(np.float32(value)) == value, f"{value!r} is no f32")
    holds = {"finite": True, "positive": value > 0, "from zero": value >= 0, "share": 0 <= value < 1}
    need(holds[wanted], f"{value!r} is not {wanted}")


def check(value, form):
    kind, *rest = form
    if kind == "f32":
        f32(value, *rest)
    elif kind == "whole":
        low, high = rest
        need(type(value) is int and low <= value <= high, f"{value!r} is not in {low} to {high}")
    elif kind in ("bool", "text"):
        need(type(value) is (bool if kind == "bool" else str), f"{value!r} is no {kind}")
    elif kind == "enum":
        need(type(value) is str and value in rest[0], f"{value!r} is not one of {rest[0]}")
    elif kind == "null":
        if value is not None:
            check(value, rest[0])
    elif kind == "list":
        of, low, high = rest
        need(type(value) is list and low <= len(value) <= high, f"{value!r} has not {low} to {high} items")
        for item in value:
            check(item, of)
    elif kind == "choice":
        key, one, other = rest
        check(value, ("object", one if type(value) is dict and key in value else other))
    else:
        keys = OBJECTS[rest[0]]
        need(type(value) is dict and value.keys() <= keys.keys(), f"{rest[0]} has other keys than {', '.join(keys)}")
        for key, (of, optional) in keys.items():
            need(optional or key in value, f"{rest[0]} has no {key}")
            if key in value:
                check(value[key], of)
        if rest[0] == "encoding":
            whole_encoding(value)
        if rest[0] == "level":
            for _, name, _, _, _, decodes in GROUPS:
                of = encoding_of(value, name)
                need(of is None or of["decode"] in decodes, f"{name} decodes as {of and of['decode']}")


def whole_encoding(value):
    need(value["bits"] in NUMBERS[value["number"]][2], f"{value['bits']} bits of {value['number']}")
    if value["number"][0] == "f":
        need(value["center"] == value["step"] == value["curve"] == 0 and not value["empty_code"], "a float with a range")


def encoding_of(level, name):
    """The encoding of a group; None if the level does not have it."""
    key, item = next((key, item) for _, group, key, item, *_ in GROUPS if group == name)
    value = level.get(key)
    if item is None or value is None:
        return value
    return value[item] if item < len(value) else None


def once(pairs):
    need(len(dict(pairs)) == len(pairs), "a key of the metadata is repeated")
    need([key.encode() for key, _ in pairs] == sorted(key.encode() for key, _ in pairs), "keys are not sorted")
    return dict(pairs)


def metadata(data):
    try:
        meta = json.loads(data.decode("utf-8"), object_pairs_hook=once)
    except (ValueError, RecursionError) as error:
        raise Refused(f"META is not JSON: {error}") from None
    check(meta, ("object", "metadata"))
    need(all(low < high for low, high in zip(meta["bounds"]["min"], meta["bounds"]["max"])), "min is not below max")
    levels = meta["levels"]
    march = meta["march"]
    parts = levels + meta.get("shells", [])
    bounds = nested(meta)
    sampled = march.get("sampled", bounds)
    for low, from_, to, high in zip(bounds["min"], sampled["min"], sampled["max"], bounds["max"]):
        need(low <= from_ < to <= high, "samples outside of the box")
    if "shells" in meta:
        voxel = march.get("voxel", [march["voxel_size"]] * 3)
        steps = math.hypot(*(edge / own for edge, own in zip(extents(bounds), voxel))) / march["stepsize"]
        need(math.floor(steps) + 1 <= 2**24, "rays of more than 2^24 steps")
    else:
        diagonal = math.hypot(*(nodes + 1 for nodes in levels[0]["dimensions"]))
        need(diagonal / march["stepsize"] < 2**20 + 1, "rays of more than 2^20 samples")
    bends, slope = meta["level_of_detail"].get("bends", []), meta["level_of_detail"]["factor"]
    for _, by in bends:
        slope += by
        need(slope > 0, "the level does not rise with the footprint")
    need(all(low[0] < high[0] for low, high in zip(bends, bends[1:])), "bends out of order")
    need(levels[0]["density"] is not None, "level 0 has no density")
    for level, finer in zip(levels[1:], meta.get("shells", []) + levels[len(meta.get("shells", [])) :]):
        need(all(a <= b for a, b in zip(level["dimensions"], finer["dimensions"])), "a level is finer than the next")
    for level in parts:
        features = 0 if harmonics_of(meta) else meta["features"]
        need((level["features"] is None) == (features == 0), "encodings of features disagree with `features`")
        decodes(meta, level)
        need("directional" not in level or brightens(meta), "directional brightness that cannot be added")
        if shape := level.get("anisotropy"):
            density = level["density"] or {"decode": "raw_density"}
            need(density["decode"] == "sqrt_optical_depth", "anisotropy of densities that are no roots of optical depth")
            need(shape["empty"] == 0, "anisotropy of empty blocks")
        need(level["blocks_stored"] <= math.prod(blocks_of(level)), "more blocks are stored than there are")
    for part, level in enumerate(parts):
        k, coarser = coarser_of(meta, part)
        filled = level.get("blocks_filled", 0)
        need(filled <= level["blocks_stored"], "more blocks are filled than are stored")
        need("directional" not in level or not coarser or "directional" in coarser, "the next coarser level has no directional brightness")
        colours = [of[key] for of in (level, coarser) if of for key in ("diffuse", "features", "directional") if of.get(key)]
        colours += [band for of in (level, coarser) if of for band in of.get("bands", [])]
        integers = all(colour["number"] in ("u8", "u16") for colour in colours)
        alike = part >= len(levels) or k == 0 or k > len(meta.get("shells", []))
        need(not filled or (coarser and integers and alike), "blocks are filled that cannot be")
    if harmonics := harmonics_of(meta):
        need(meta["features"] == 3 * ((harmonics["degree"] + 1) ** 2 - 1), "features and degree disagree")
        need(harmonics["clamp"] != "sigmoid" or harmonics["where"] == "sample", "a sigmoid once a ray")
    if "function" in meta["activation"]:
        need(meta["activation"]["shift"] == 0, "a shift beside relu")
    if view := network_of(meta):
        first = 3 + 6 * view["frequencies"] + meta["features"] + 3 * (view["input"] == "diffuse_and_features")
        need(view["widths"][0] == first and view["widths"][-1] == 3, "first or last width of the network")
    return meta


def extents(box):
    return [high - low for low, high in zip(box["min"], box["max"])]


def coarser_of(meta, part):
    """The number of a part's level, and the next coarser level, if there is one."""
    levels = meta["levels"]
    k = part if part < len(levels) else part - len(levels) + 1
    return k, levels[k + 1] if k + 1 < len(levels) else None


def nested(meta):
    """The box of everything, once each box lies around the smaller one."""
    levels, shells, box = meta["levels"], meta.get("shells", []), meta["bounds"]
    need(len(shells) < len(levels), "as many shells as levels")
    need(not shells or meta["blend"] == "after_activation", "shells of levels that are mixed before activation")
    need(not any("bounds" in level for level in levels), "a level with a box of its own")
    nodes = levels[0]["dimensions"]
    for shell in shells:
        need("bounds" in shell, "a shell without a box")
        larger, more = shell["bounds"], shell["dimensions"]
        need(all(low < high for low, high in zip(larger["min"], larger["max"])), "a shell whose min is not below max")
        holds = all(a <= b for a, b in zip(larger["min"], box["min"])) and all(a >= b for a, b in zip(larger["max"], box["max"]))
        need(holds and larger != box, "a shell that does not lie around the smaller box")
        spacings = [[edge / (n - 1) for edge, n in zip(extents(of), count)] for of, count in ((larger, more), (box, nodes))]
        need(all(1.5 <= a / b <= 3 for a, b in zip(*spacings)), "nodes of a shell that are not 1.5 to 3 times as far apart")
        box, nodes = larger, more
    return box


def harmonics_of(meta):
    view = meta["view"]
    return view if view and "kind" in view else None


def network_of(meta):
    view = meta["view"]
    return view if view and "kind" not in view else None


def decodes(meta, level):
    """Values mean what the view dependence asks for."""
    harmonics, bands = harmonics_of(meta), level.get("bands", [])
    need(len(bands) == (harmonics["degree"] if harmonics else 0), "another number of bands than the degree")
    for number, band in enumerate(bands, 1):
        need(band["decode"] == f"band_{number}", f"band {number} decodes as {band['decode']}")
    linear = meta["levels"][0]["diffuse"]["decode"] == "linear"
    need(not linear or meta["view"] is None, "linear colours beside view dependence")
    wanted = "band_0" if harmonics else "linear" if linear else "logit"
    need(level["diffuse"]["decode"] == wanted, f"diffuse colour decodes as {level['diffuse']['decode']}")


def brightens(meta):
    """Whether levels may have directional brightness: it is added to logits of each level."""
    fits = meta["blend"] == "after_activation" and meta["features"] <= 58
    return fits and all(level["diffuse"]["decode"] == "logit" for level in meta["levels"])


def is_linear(meta):
    """Bit 1 of the required features."""
    linear = any(level["diffuse"]["decode"] == "linear" for level in meta["levels"])
    march = {"sampled", "voxel"} & set(meta["march"])
    return linear or harmonics_of(meta) is not None or "function" in meta["activation"] or bool(march)


def blocks_of(level):
    return [-(-nodes // level["block_size"]) for nodes in level["dimensions"]]


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


# Sections 4 and 5: the chunks.


def inflate(data, size, what):
    """One zstd frame of exactly `size` bytes, and nothing after it."""
    try:
        stated = zstandard.frame_content_size(data)
        need(stated in (-1, size), f"{what}: the frame holds {stated} bytes, not {size}")
        out = zstandard.ZstdDecompressor().decompress(data, max_output_size=size, allow_extra_data=False)
    except (zstandard.ZstdError, OverflowError, MemoryError) as error:
        raise Refused(f"{what}: {error}") from None
    need(len(out) == size, f"{what}: {len(out)} bytes, not {size}")
    return out


def runs_of(data, total, what):
    """The table of a file of nested boxes: a number for each run of equal blocks."""
    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError as error:
        raise Refused(f"{what}: {error}") from None
    need(0 <= size <= total, f"{what}: states {size} bytes")
    data, at, table, before = inflate(data, size, what), 0, np.zeros(total, np.uint8), None
    block = 0
    while at < size:
        number = shift = 0
        while True:
            need(at < size and shift < 63, f"{what}: a number without an end")
            byte, at = data[at], at + 1
            number, shift = number | (byte & 0x7F) << shift, shift + 7
            if byte < 0x80:
                break
        need(byte or shift == 7, f"{what}: a number of more bytes than it needs")
        length, value = number >> 2, number & 3
        need(1 <= length <= total - block and value != before, f"{what}: a run of {length} blocks")
        need(value <= 2, f"{what}: a block that is none of 0, 1 and 2")
        table[block : block + length], block, before = value, block + length, value
    need(block == total, f"{what}: runs of {block} blocks, not {total}")
    return table


def network(data, widths):
    values, at, out = np.frombuffer(data, "<f4", len(data) // 4), 0, {}
    need(len(data) == 4 * sum((a + 1) * b for a, b in zip(widths, widths[1:])), "VMLP has another size")
    need(np.isfinite(values).all(), "VMLP holds a number that is not finite")
    for i, (a, b) in enumerate(zip(widths, widths[1:])):
        out[f"mlp.{i}.weight"] = values[at : at + a * b].reshape(b, a)
        out[f"mlp.{i}.bias"] = values[at + a * b : at + (a + 1) * b]
        at += (a + 1) * b
    return out


def mask(data):
    need(len(data) >= 72, "MASK is too short")
    lookup, *nodes = struct.unpack_from("<4I", data)
    scale, shift = np.frombuffer(data, "<f8", 6, 16).reshape(2, 3)
    threshold, zero = struct.unpack_from("<fI", data, 64)
    need(lookup in (0, 1) and zero == 0 and min(nodes) >= 2, "MASK: lookup, nodes or reserved field")
    need(np.isfinite([*scale, *shift, threshold]).all(), "MASK holds a number that is not finite")
    need(lookup or struct.pack("<f", threshold) == bytes(4), "MASK: a threshold for nearest")
    kind = np.dtype("<f4" if lookup else "u1")
    values = np.frombuffer(inflate(data[72:], math.prod(nodes) * kind.itemsize, "MASK"), kind).reshape(nodes)
    need(np.isfinite(values).all() if lookup else values.max() <= 1, "MASK: a value of a node")
    # The names and the third row are those of unpacked files.
    table = np.array([scale, shift, [threshold, 0, 0]])
    return {"free_space.map": table, "free_space.values" if lookup else "free_space.inside": values}


def codes_of(data, stored, channels, width, first, b, what):
    """All codes of an atlas as uint64 [channels, frames, nodes]; `width` is in bytes."""
    need(len(data) >= 8, f"{what} is too short")
    full, runs = struct.unpack_from("<II", data)
    need(full >= 1 and runs == -(-stored // full), f"{what}: {runs} runs of {full} frames for {stored} blocks")
    at = 8 + 4 * runs
    need(len(data) >= at, f"{what} is too short")
    out = np.zeros((channels, stored, b**3), np.uint64)
    for run, word in enumerate(struct.unpack_from(f"<{runs}I", data, 8)):
        piece, at = data[at : at + (word & 0x7FFFFFFF)], at + (word & 0x7FFFFFFF)
        need(at <= len(data), f"{what}: run {run} goes beyond the chunk")
        if not word >> 31:
            try:
                size = zstandard.frame_content_size(piece)
            except zstandard.ZstdError as error:
                raise Refused(f"{what}, run {run}: {error}") from None
            frames = min(full, stored - run * full)
            most = 1 + 255 * 5 * channels + frames * (1 + b**3 * (1 + channels * width))
            need(0 <= size <= most, f"{what}, run {run}: states {size} bytes")
            piece = inflate(piece, size, f"{what}, run {run}")
        part = slice(run * full, min((run + 1) * full, stored))
        out[:, part] = run_of(piece, part.stop - part.start, channels, width, first, b, f"{what}, run {run}")
    need(at == len(data), f"{what}: bytes after the last run")
    return out


def run_of(data, frames, channels, width, first, b, what):
    """The codes of one run, [channels, frames, nodes]."""
    nodes, at = b**3, 0

    def take(count):
        nonlocal at
        need(at + count <= len(data), f"{what} is too short")
        at += count
        return np.frombuffer(data, np.uint8, count, at - count)

    modes = int(take(1)[0])
    need(modes >= 1, f"{what} has no modes")
    weights = np.zeros((modes, channels, 5), np.int64)
    for mode in range(modes):
        for channel in range(channels):
            count = 2 + min(channel, 3)
            weights[mode, channel, :count] = take(count).view(np.int8)
    mode_of = take(frames)
    need(mode_of.max() < modes, f"{what}: a mode that it does not have")
    bits = np.unpackbits(take(frames * -(-nodes // 8)).reshape(frames, -1), axis=1, bitorder="little")
    need(not bits[:, nodes:].any(), f"{what}: a live bit beyond the last node")
    live = bits[:, :nodes] == 1
    residual = np.zeros((channels, frames, nodes), np.int64)
    for channel in range(channels):
        for byte in range(width):
            for mode in range(modes):
                for frame in np.flatnonzero(mode_of == mode):
                    here = live[frame]
                    residual[channel, frame, here] |= take(here.sum()).astype(np.int64) << (8 * byte)
    need(at == len(data), f"{what}: bytes after the last residual")
    residual -= sum(0x80 << (8 * byte) for byte in range(width))
    # Nodes of the same x + y + z need only those of smaller sums, so one such diagonal goes at a time, in every frame at once.
    x, y, z = np.indices((b, b, b)).reshape(3, -1)
    codes = np.zeros((channels, frames, nodes), np.int64)
    difference = np.zeros_like(codes)
    for channel in range(channels):
        w = weights[mode_of, channel].T[:, :, None]
        for diagonal in range(3 * b - 2):
            node = np.flatnonzero(x + y + z == diagonal)

            def neighbour(dx, dy, dz):
                has = (x[node] >= dx) & (y[node] >= dy) & (z[node] >= dz)
                lower = np.where(has, node - (dx * b + dy) * b - dz, 0)
                return has, codes[channel][:, lower]

            lower = [neighbour(*axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
            count = sum(has.astype(np.int64) for has, _ in lower)
            mean = sum(np.where(has, code, 0) for has, code in lower) // count if diagonal else np.full((frames, 1), first)

            def beyond(*offset):
                has, code = neighbour(*offset)
                return np.where(has, code - mean, 0)

            terms = [beyond(1, 1, 0) + beyond(1, 0, 1) + beyond(0, 1, 1), beyond(1, 1, 1)]
            terms += [difference[channel - j][:, node] for j in (1, 2, 3) if j <= channel]
            prediction = mean + ((sum(a * t for a, t in zip(w, terms)) + 16) >> 5)
            whole = (prediction + residual[channel][:, node]) & ((1 << 8 * width) - 1)
            codes[channel][:, node] = np.where(live[:, node], whole, mean)
            difference[channel][:, node] = codes[channel][:, node] - mean
    return codes.astype(np.uint64)


def values_of(codes, encoding):
    """Codes to f32: each operation rounded, innermost first."""
    width, _, _, float_type = NUMBERS[encoding["number"]]
    if float_type:
        unsigned, top = np.dtype(f"u{width}"), np.uint64(1 << 8 * width - 1)
        bits = np.where(codes & top, codes ^ top, ~codes).astype(unsigned)  # the cast drops the upper bits
        return bits.view(float_type).astype(np.float32)
    center, step, curve, empty = (np.float32(encoding[key]) for key in ("center", "step", "curve", "empty"))
    x = (codes.astype(np.int64) - (1 << encoding["bits"] - 1)).astype(np.float32)
    values = center + x * (step + curve * (x * x))
    return np.where(codes == 0, empty, values) if encoding["empty_code"] else values


def filled_from(coarser, level, encoding, of_coarser):
    """What the next coarser level's dense array says of every node of a level, as values of the level's own codes."""
    grid = coarser.astype(np.float64)
    # Along z first, then y, then x; each operation rounded to f64.
    for axis in (2, 1, 0):
        nodes, fewer = level["dimensions"][axis], of_coarser["dimensions"][axis]
        at = np.arange(nodes) * (fewer - 1)
        low = np.minimum(at // (nodes - 1), fewer - 2)
        share = (at - low * (nodes - 1)) / np.float64(nodes - 1)
        lower, upper = (grid.take(low + up, axis=axis + 1) for up in (0, 1))
        grid = lower + share.reshape([-1 if i == axis else 1 for i in range(3)]) * (upper - lower)
    own = values_of(np.arange(1 << encoding["bits"], dtype=np.uint64), encoding)
    borders = (own[:-1].astype(np.float64) + own[1:].astype(np.float64)) / 2
    return own[np.searchsorted(borders, grid, side="right")]


def atlas(data, channels, level, table, encoding, what, coarser=None):
    """The dense array [channels, Nx, Ny, Nz] of one atlas. Where `coarser` is given, the dense array and the metadata of
    the next coarser level, filled blocks have no frames and are made of it."""
    occupied = table == 1 if coarser else table > 0
    b = level["block_size"]
    width, first, _, _ = NUMBERS[encoding["number"]]
    codes = codes_of(data, int(occupied.sum()), channels, width, first, b, what)
    # Of nodes beyond the grid's end too: their values are arbitrary, their codes are codes.
    need(not (codes >> np.uint64(encoding["bits"])).any(), f"{what}: a code has more than its bits")
    blocks = np.full((channels, *occupied.shape, b, b, b), np.float32(encoding["empty"]), np.float32)
    # Booleans pick blocks in C order, which is that of the frames.
    blocks[:, occupied] = values_of(codes, encoding).reshape(channels, -1, b, b, b)
    grid = blocks.transpose(0, 1, 4, 2, 5, 3, 6).reshape(channels, *(n * b for n in occupied.shape))
    nx, ny, nz = level["dimensions"]
    grid = grid[:, :nx, :ny, :nz]
    if coarser and (table == 2).any():
        here = table == 2
        for axis in range(3):
            here = here.repeat(b, axis=axis)
        grid = np.where(here[:nx, :ny, :nz], filled_from(coarser[0], level, encoding, coarser[1]), grid)
    return grid


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
