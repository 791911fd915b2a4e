"""Tables of the format, written by `cargo xtask generate` from formats/container.toml.

A form is ("f32", range), ("whole", least, most), ("bool",), ("text",), ("enum", names), ("object", name),
("choice", key, with it, without it), ("list", form, least, most) or ("null", form).
"""

MAJOR = 1
# Required features, from bit 0 on.
FEATURES = (
    "inherited_blocks",
    "linear_values",
    "bent_rule",
    "directional",
    "anisotropy",
    "nested_boxes",
)
# Chunk types that are no atlases.
CHUNKS = (
    "META",
    "VMLP",
    "MASK",
    "prov",
    "thmb",
    "TABL",
)
# Groups of values in the order of their atlases: chunk type, name, key and item of the encoding, channels, decodes.
GROUPS = (
    ("DENS", "density", "density", None, 1, ("raw_density", "sqrt_optical_depth", "opacity")),
    ("DIFF", "diffuse", "diffuse", None, 3, ("logit", "linear", "band_0")),
    ("FEAT", "features", "features", None, "features", ("logit",)),
    ("BNDA", "band_1", "bands", 0, 9, ("band_1",)),
    ("BNDB", "band_2", "bands", 1, 15, ("band_2",)),
    ("BNDC", "band_3", "bands", 2, 21, ("band_3",)),
    ("DIRB", "directional", "directional", None, 3, ("directional_logit",)),
    ("ANIS", "anisotropy", "anisotropy", None, 5, ("directional_sqrt_depth",)),
)
# Keys of objects, and whether they may be missing.
OBJECTS = {
    "box": {
        "max": (("list", ("f32", "finite"), 3, 3), False),
        "min": (("list", ("f32", "finite"), 3, 3), False),
    },
    "activation": {
        "shift": (("f32", "finite"), False),
        "interval": (("f32", "positive"), False),
        "order": (("enum", ("raw", "density", "opacity")), False),
        "function": (("enum", ("relu",)), True),
    },
    "march": {
        "stepsize": (("f32", "positive"), False),
        "voxel_size": (("f32", "positive"), False),
        "voxel": (("list", ("f32", "positive"), 3, 3), True),
        "near": (("f32", "from zero"), False),
        "far": (("null", ("f32", "finite")), False),
        "color_threshold": (("f32", "share"), False),
        "alpha_threshold": (("f32", "share"), False),
        "sampled": (("object", "box"), True),
    },
    "level_of_detail": {
        "factor": (("f32", "positive"), False),
        "bias": (("f32", "finite"), False),
        "aside": (("enum", ("same_distance", "same_index")), False),
        "most": (("null", ("f32", "from zero")), False),
        "bends": (("list", ("list", ("f32", "finite"), 2, 2), 1, 6), True),
    },
    "network": {
        "widths": (("list", ("whole", 1, 4096), 2, 32), False),
        "frequencies": (("whole", 0, 32), False),
        "input": (("enum", ("diffuse_and_features", "features")), False),
    },
    "harmonics": {
        "clamp": (("enum", ("zero", "none", "sigmoid")), False),
        "degree": (("whole", 0, 3), False),
        "kind": (("enum", ("spherical_harmonics",)), False),
        "offset": (("f32", "finite"), False),
        "where": (("enum", ("ray", "sample")), False),
    },
    "encoding": {
        "number": (("enum", ("u8", "u16", "f16", "f32")), False),
        "bits": (("whole", 1, 32), False),
        "center": (("f32", "finite"), False),
        "step": (("f32", "finite"), False),
        "curve": (("f32", "finite"), False),
        "empty": (("f32", "finite"), False),
        "empty_code": (("bool",), False),
        "decode": (("enum", ("logit", "linear", "band_0", "band_1", "band_2", "band_3", "directional_logit", "directional_sqrt_depth", "raw_density", "sqrt_optical_depth", "opacity")), False),
        "max_error": (("f32", "from zero"), False),
    },
    "level": {
        "dimensions": (("list", ("whole", 2, 65536), 3, 3), False),
        "block_size": (("whole", 1, 64), False),
        "bounds": (("object", "box"), True),
        "blocks_stored": (("whole", 0, 8589934592), False),
        "blocks_filled": (("whole", 1, 8589934592), True),
        "density": (("null", ("object", "encoding")), False),
        "diffuse": (("object", "encoding"), False),
        "features": (("null", ("object", "encoding")), False),
        "bands": (("list", ("object", "encoding"), 1, 3), True),
        "directional": (("object", "encoding"), True),
        "anisotropy": (("object", "encoding"), True),
    },
    "metadata": {
        "bounds": (("object", "box"), False),
        "activation": (("object", "activation"), False),
        "march": (("object", "march"), False),
        "step_rule": (("enum", ("constant", "level_of_detail")), False),
        "level_of_detail": (("object", "level_of_detail"), False),
        "blend": (("enum", ("before_activation", "after_activation")), False),
        "background": (("list", ("f32", "finite"), 3, 3), False),
        "color_space": (("enum", ("srgb_display",)), False),
        "features": (("whole", 0, 61), False),
        "view": (("null", ("choice", "kind", "harmonics", "network")), False),
        "free_space": (("bool",), False),
        "alpha_threshold": (("f32", "share"), False),
        "filter": (("text",), False),
        "levels": (("list", ("object", "level"), 1, 32), False),
        "shells": (("list", ("object", "level"), 1, 31), True),
    },
}
