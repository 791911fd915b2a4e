"""Sections 4 and 5: the chunks of a container, decoded."""

import math
import struct

import numpy as np
import zstandard

from description import NUMBERS, Refused, need


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
