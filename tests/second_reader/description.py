"""Section 4: the metadata of a container, by the forms in `tables.py`, and what it says of the arrays."""

import json
import math

import numpy as np

from tables import GROUPS, OBJECTS

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
