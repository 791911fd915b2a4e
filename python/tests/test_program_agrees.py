"""The module gives what the program gives: reports, levels, stored values and rays."""

import inspect
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mipvog_bake

PROGRAM = Path(sys.executable).with_name("mipvog-bake")
TRAINED = Path(__file__).parents[2] / "fixtures" / "trained" / "tiny" / "fine_last.tar"
TYPES = {"F32": np.float32, "U8": np.uint8}
# What differs from run to run.
TIMES = ("seconds", "stages", "peak_memory_bytes", "output")


def program(*arguments):
    done = subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def tensors(path):
    """The arrays and the texts of a file of safetensors."""
    data = path.read_bytes()
    start = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:start])
    texts = header.pop("__metadata__", {})
    arrays = {}
    for name, entry in header.items():
        begin, end = (start + offset for offset in entry["data_offsets"])
        values = np.frombuffer(data[begin:end], dtype=TYPES[entry["dtype"]])
        arrays[name] = values.reshape(entry["shape"])
    return arrays, texts


def write(path, arrays):
    """A file of safetensors with arrays of float32."""
    header, parts, end = {}, [], 0
    for name, array in arrays.items():
        parts.append(np.ascontiguousarray(array, dtype="<f4").tobytes())
        offsets = [end, end + len(parts[-1])]
        header[name] = {"dtype": "F32", "shape": array.shape, "data_offsets": offsets}
        end = offsets[1]
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + b"".join(parts))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("agrees")
    options = ("--stepsize=0.5", "--bits=10", "--background=0,0,0", "--format=json")
    report = program("bake", TRAINED, "-o", folder / "program.mipvog", *options)
    (folder / "report.json").write_text(report, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def field(folder):
    return mipvog_bake.open(folder / "program.mipvog")


def test_options_are_the_long_names_and_the_result_is_the_report(folder):
    output = folder / "module.mipvog"
    options = {"stepsize": 0.5, "bits": 10, "background": (0, 0, 0)}
    found = mipvog_bake.bake(str(TRAINED), output, **options)
    expected = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert found.keys() == expected.keys() and found["output"] == str(output)
    for key in found.keys() - set(TIMES):
        assert found[key] == expected[key], key
    assert [s["name"] for s in found["stages"]] == [s["name"] for s in expected["stages"]]
    assert output.read_bytes() == (folder / "program.mipvog").read_bytes()


def test_a_field_states_what_inspect_states(folder, field):
    stated = json.loads(program("inspect", folder / "program.mipvog", "--format=json"))
    assert list(field.dimensions) == stated["dimensions"]
    assert field.levels == stated["levels"]
    assert field.bounds._asdict() == {
        side: tuple(corner) for side, corner in stated["bounds"].items()
    }


def test_unpack_gives_the_arrays_of_the_program(folder, field):
    path = folder / "unpacked.safetensors"
    program("unpack", folder / "program.mipvog", "-o", path)
    expected, texts = tensors(path)
    found = field.unpack()
    assert found.keys() == expected.keys()
    assert {"level0.density", "level0.features", "level0.occupied", "mlp.0.weight"} < found.keys()
    for name, array in found.items():
        assert array.dtype == expected[name].dtype and np.array_equal(array, expected[name]), name
        assert array.flags.c_contiguous
    assert field.metadata == json.loads(texts["mipvog"])


@pytest.mark.parametrize("level", [None, 1])
def test_probe_gives_the_rays_of_the_program(folder, field, level):
    random = np.random.default_rng(4)
    ways = random.normal(size=(50, 3))
    ways = (ways / np.linalg.norm(ways, axis=1, keepdims=True)).astype(np.float32)
    low, high = np.array(field.bounds)
    origins = (random.uniform(low, high, size=(50, 3)) - 3 * ways).astype(np.float32)
    rays, output = folder / "rays.safetensors", folder / f"out{level}.safetensors"
    write(rays, {"origins": origins, "directions": ways})
    choice = "off" if level is None else str(level)
    words = ("--rays", rays, "-o", output, "--level-of-detail", choice)
    program("probe", folder / "program.mipvog", *words)
    expected, _ = tensors(output)
    names = ("rgb", "transmittance", "depth")
    assert expected["transmittance"].min() < 0.5 < expected["transmittance"].max()
    found = field.probe(origins, ways, level)
    for name, array in zip(names, found, strict=True):
        assert array.dtype == np.float32 and array.shape == expected[name].shape
        assert np.allclose(array, expected[name], atol=1e-4), name


def test_arguments_have_the_names_that_are_promised():
    promised = {
        mipvog_bake.bake: "input output *progress **options",
        mipvog_bake.open: "path",
        mipvog_bake.from_arrays: "density *diffuse *features *network *bounds *shift *interval "
        "*stepsize",
        mipvog_bake.from_model: "density color *bounds *resolution *background *sh_degree *device "
        "*max_memory *cameras",
        mipvog_bake.Field.unpack: "self levels",
        mipvog_bake.Field.probe: "self origins directions level",
        mipvog_bake.Field.sample: "self positions level",
        mipvog_bake.Field.render: "self camera size",
    }
    stars = {inspect.Parameter.KEYWORD_ONLY: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    for function, names in promised.items():
        parameters = inspect.signature(function).parameters.values()
        found = [stars.get(one.kind, "") + one.name for one in parameters]
        assert set(names.split()) <= set(found), function
        plain = [name for name in names.split() if not name.startswith("*")]
        assert found[: len(plain)] == plain, function
    assert issubclass(mipvog_bake.Error, Exception)
    error = mipvog_bake.Error("a", kind="b", place="c", file="d", exit_code=3)
    assert (error.kind, error.place, error.file, error.exit_code) == ("b", "c", "d", 3)
