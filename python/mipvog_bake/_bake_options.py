"""The options of `bake`. They follow from the program's parser:
`BLESS=1 cargo test the_options_of_python` renews this file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Optional, TypedDict, Union

# What the program reads as text: one value, or several.
Words = Union[str, int, float, Sequence[Any], Mapping[str, Any]]
PathName = Union[str, os.PathLike[str]]
PathNames = Union[PathName, Sequence[PathName]]


class BakeOptions(TypedDict, total=False):
    """Options of `bake`. One that is None or False is not given."""

    allow_network: Optional[bool]
    """Allow https:// inputs; needs a program built with the feature network. Without this option,
    the network is not used."""

    alpha_threshold: Optional[Words]
    """Drop blocks whose opacity over one step of the level never exceeds this, 0 to 1 [default:
    0.001]"""

    appearance: Optional[Words]
    """Appearance of a nerfacto model: mean, zero, or that of a training picture by its number, from
    0 [default: as in nerfstudio's own pictures]"""

    background: Optional[Words]
    """Colour behind the field: one number or three, 0 to 1, or #RRGGBB, white, black [default:
    likewise; else white]"""

    bits: Optional[Words]
    """Bits per stored value: 4 to 16, f16 or f32 [default: 8]"""

    block_size: Optional[Words]
    """Voxels along a block's edge, 1 to 64 [default: 8]"""

    camera_transform: Optional[PathName]
    """nerfstudio's dataparser_transforms.json, which leads from the camera file's world to that of
    the training: for models of nerfstudio, and their bakes."""

    cameras: Optional[PathName]
    """Camera file: NeRF-synthetic's transforms.json or nerfstudio's, or images.bin or images.txt of
    a COLMAP model; or the folder with it."""

    coarse: Optional[PathName]
    """Coarse checkpoint, which has the threshold of the free-space mask [default: beside the
    input]"""

    coarseness: Optional[Words]
    """How far colours may drift where cameras see little, in quantization steps at a voxel of
    average visibility, 0 to 64 [default: 0]"""

    color_threshold: Optional[float]
    """Skip the colour of samples whose weight is at most this, 0 to 1 [default: likewise; else
    0.0001, or 0 for models without a network]"""

    deny_warnings: Optional[bool]
    """Exit with 1 if there is a warning; bake and export then write nothing."""

    depfile: Optional[PathName]
    """Write a dependency file for Make or Ninja: the container, and every file that it was made
    from."""

    drop_background: Optional[bool]
    """Keep only the inner box of an unbounded scene. Left out are Plenoxels' background spheres,
    the contracted space of DirectVoxGO, MERF and nerfacto, and all beyond the unit cube of
    Instant-NGP."""

    extent: Optional[float]
    """How far the outermost box of an unbounded scene reaches, in half sides of its inner box
    [default: all that the model shows]"""

    external: Optional[bool]
    """Link a .glb to the container by URI instead of embedding it."""

    fallback_lods: Optional[Words]
    """Number of coarser meshes, each with a quarter of the triangles, as levels of detail
    (MSFT_lod)."""

    fallback_triangles: Optional[int]
    """Maximum number of triangles in the mesh."""

    far: Optional[float]
    """Farthest distance at which sampling may start; rays are not cut there [default: likewise;
    else unlimited]"""

    field: Optional[int]
    """Select a field of a glTF asset [default: 0]"""

    fill_error: Optional[Words]
    """Leave out a block's colours where the next coarser level reproduces them to within this
    error, above 0 to 1; with --min-weight or --coarseness, less exactly where --cameras see little
    [default: store all]"""

    filter: Optional[Words]
    """Filter that makes coarser levels [default: rate-tent]"""

    fit_cameras: Optional[PathName]
    """Camera file for the reference pictures of `--filter fit`; a gate must use other cameras
    [default: spheres around the box]"""

    fit_seconds: Optional[float]
    """Time limit of `--filter fit` in seconds, including its reference pictures. The output then
    depends on the machine [default: unlimited]"""

    fit_steps: Optional[int]
    """Maximum number of steps of `--filter fit` [default: 130, or 1500 with --photographs]"""

    force: Optional[bool]
    """Overwrite the output if it exists."""

    frames: Optional[Words]
    """Frames, by name, path or number [default: all]"""

    gltf: Optional[PathName]
    """Also write a glTF asset, .glb or .gltf; it has the field, and a mesh for other viewers."""

    grid: Optional[Words]
    """Grid of an OpenVDB file that holds density [default: density, else the only fog volume]"""

    if_changed: Optional[bool]
    """Bake only if the input, the options or the version differ from those of the existing
    container, and replace it."""

    levels: Optional[Words]
    """Maximum number of levels [default: down to 4 voxels along the longest axis]"""

    limit: Optional[Words]
    """Set a limit on what files may request, such as memory=1000000000; can be repeated. An unknown
    name lists all limits."""

    lod_rule: Optional[Words]
    """Published rule that picks the level of a sample [default: the filter's own]"""

    lod_scale: Optional[Words]
    """Factor on the slope of the level rule [default: 1]"""

    max_bytes: Optional[Words]
    """Largest size of the container, such as 3MB or 500KiB; the best quality that fits is chosen,
    and the finest levels are dropped if nothing fits. Replaces --bits, --max-error and
    --quality."""

    max_error: Optional[Words]
    """Largest error of colour (0 to 1) and of opacity over one interval, 1e-6 to 0.25; every level
    gets the fewest bits that satisfy it. Three bounds with colons are for opacity, diffuse colour
    and features. Replaces --bits."""

    memory: Optional[Words]
    """Memory limit, such as 500MB or 2GiB; a low limit is slower and gives the same output
    [default: unlimited]"""

    merge: Optional[PathNames]
    """Add the scene of this file, at its place in the world; may be given several times. The grid
    of INPUT is extended to hold the other scenes."""

    min_weight: Optional[Words]
    """Drop voxels that add less than this to every pixel of --cameras, above 0 to 1; other
    viewpoints may miss parts [default: keep all]"""

    mlp: Optional[PathName]
    """View network: auto (the checkpoint's), none, or a file."""

    near: Optional[float]
    """Distance along the camera's axis at which rays start [default: likewise; else 0]"""

    nonfinite: Optional[Words]
    """What to do with values that are not finite [default: refuse]"""

    photographs: Optional[PathName]
    """Folder of photographs for `--filter fit` to fit coarser levels to, instead of renders of
    level 0; taken from --fit-cameras or else --cameras. One in eight is held out."""

    preset: Optional[Words]
    """Set of options; explicit options override it."""

    quality: Optional[Words]
    """Quality of pictures, 1 to 100; 75 equals --preset web, and every 25 less doubles the errors.
    Replaces --bits and --max-error. With --cameras or --turntable, also sets --min-weight,
    --coarseness and --fill-error."""

    require_psnr: Optional[float]
    """Write nothing and exit with 1 if the PSNR in dB against the unbaked scene is below this; at
    full size, over the pixels of all cameras."""

    require_view_psnr: Optional[float]
    """Write nothing and exit with 1 if the PSNR in dB of fitted colours is below this; against the
    model's, in held-out directions."""

    resolution: Optional[int]
    """Voxels along the longest axis of a model without a grid, such as Instant-NGP [default: 256;
    for the first box of an unbounded scene, as many as the model has]. For PeRFception's Plenoxels,
    cells along each axis."""

    scene_scale: Optional[float]
    """Input units per scene unit, such as 0.66667 for Plenoxels of NeRF-synthetic scenes [default:
    from the input or a file beside it, else 1]"""

    size: Optional[Words]
    """Picture size in pixels, or one number for a square [default: the camera file's; else its
    pictures'; else 800x800]"""

    stepsize: Optional[float]
    """Step length in voxels [default: the container's; else that of scene.toml, scene.json, the
    camera file or the checkpoint; else 0.5, with a warning]"""

    threads: Optional[int]
    """Number of threads, 0 to 256; 0 means one per processor."""

    thumbnail: Optional[int]
    """Put a square picture of the scene into the container, this many pixels wide, for file
    managers and asset libraries; inspect --thumbnail extracts it."""

    turntable: Optional[int]
    """N cameras on a circle around the box; instead of a camera file."""

    view: Optional[Words]
    """View-dependent colour: keep, none, or sh:D for harmonics up to degree D, 0 to 3."""

    zstd_level: Optional[Words]
    """Compression level of zstd, 1 to 22 [default: 1]"""


# Options that name files to read.
INPUTS = ("camera_transform", "cameras", "coarse", "fit_cameras", "merge", "mlp", "photographs")
# Options that name files to write.
OUTPUTS = ("depfile", "gltf")
