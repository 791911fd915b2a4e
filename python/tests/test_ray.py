"""Many scenes on a cluster of this machine."""

from __future__ import annotations

import json
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("ray")
pytest.importorskip("fsspec")

import ray  # noqa: E402
from ray.cluster_utils import Cluster  # noqa: E402

from mipvog_bake.ray import manifest, program, store  # noqa: E402
from mipvog_bake.ray.__main__ import main  # noqa: E402
from mipvog_bake.ray.failure import Failure  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
TRAINED = ROOT / "fixtures/trained"
TINY = TRAINED / "tiny/fine_last.tar"
SMALL = TRAINED / "dvgo/flat.npz"

try:
    TOOL = program.find(None)
except Failure:
    pytest.skip("no program mipvog-bake here", allow_module_level=True)


def write(path: Path, lines: list[dict[str, Any]]) -> Path:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    return path


def report_of(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def single(tmp_path: Path, scene: dict[str, Any]) -> bytes:
    """The bytes of a bake by the program alone."""
    manifest = write(tmp_path / "single.jsonl", [scene])
    subprocess.run(
        [TOOL, "bake", "--manifest", str(manifest), "-o", str(tmp_path / "single"), "--force"],
        check=True,
        capture_output=True,
    )
    return (tmp_path / "single" / scene["output"]).read_bytes()


def catalogue(folder: Path, count: int, damaged: set[int]) -> list[dict[str, Any]]:
    """Scenes of two inputs and several settings, and inputs that are cut."""
    folder.mkdir()
    shutil.copy(SMALL, folder / "sound.npz")
    (folder / "cut.npz").write_bytes(SMALL.read_bytes()[:9000])
    return [
        {
            "input": "cut.npz" if number in damaged else "sound.npz",
            "output": f"{number % 10}/{number}.mipvog",
            "options": {"stepsize": 0.5, "bits": 4 + number % 12},
        }
        for number in range(count)
    ]


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    memory = 1 << 30
    nodes = Cluster(
        initialize_head=True,
        head_node_args={"num_cpus": 1, "memory": memory, "object_store_memory": 80 << 20},
    )
    yield nodes
    ray.shutdown()
    nodes.shutdown()


def add_node(cluster: Cluster) -> Any:
    return cluster.add_node(num_cpus=1, memory=1 << 30, object_store_memory=80 << 20)


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_a_catalogue_outlives_a_lost_node(tmp_path: Path, cluster: Cluster) -> None:
    damaged = {7, 50, 51, 120, 199}
    scenes = catalogue(tmp_path / "in", 200, damaged)
    lines = write(tmp_path / "in/scenes.jsonl", scenes)
    lost = add_node(cluster)
    out, report = tmp_path / "out", tmp_path / "report.jsonl"
    arguments = [str(lines), "--output", str(out), "--address", cluster.address]
    ended: list[int] = []
    run = threading.Thread(target=lambda: ended.append(main([*arguments, "--report", str(report)])))
    run.start()
    while run.is_alive() and not (report.exists() and len(report_of_part(report)) > 20):
        time.sleep(0.05)
    assert run.is_alive(), "the node was to be lost amid the work"
    cluster.remove_node(lost, allow_graceful=False)
    add_node(cluster)
    run.join()
    assert ended == [1]

    results = report_of(report)
    assert sorted(result["output"] for result in results) == sorted(s["output"] for s in scenes)
    failed = {result["output"]: result for result in results if result["status"] == "failed"}
    assert set(failed) == {scenes[number]["output"] for number in damaged}
    for result in failed.values():
        assert result["exit_code"] == 3 and "cut.npz" in result["error"]
    # Nothing is left but whole outputs.
    whole = {scene["output"] for scene in scenes} - set(failed)
    assert files(out) == whole
    bytes_of = {
        bits: single(tmp_path / "in", scenes[bits - 4])
        for bits in range(4, 16)
        if bits - 4 not in damaged
    }
    bytes_of[11] = single(tmp_path / "in", scenes[19])
    for number, scene in enumerate(scenes):
        if number not in damaged:
            found = (out / scene["output"]).read_bytes()
            assert found == bytes_of[4 + number % 12], scene["output"]

    # Another run bakes nothing that is there, and tells of the same failures.
    before = {name: (out / name).stat().st_mtime_ns for name in whole}
    assert main([*arguments, "--report", str(report)]) == 1
    results = report_of(report)
    states = [result["status"] for result in results]
    assert (states.count("current"), states.count("failed")) == (195, 5)
    assert before == {name: (out / name).stat().st_mtime_ns for name in whole}


def report_of_part(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def test_a_forecast_asks_for_the_memory_of_a_scene(tmp_path: Path, cluster: Cluster) -> None:
    from mipvog_bake.ray import task
    from mipvog_bake.ray.driver import _larger
    from mipvog_bake.ray.manifest import Scene

    ray.init(address=cluster.address, log_to_driver=False)
    scene = Scene(str(TINY), "tiny.mipvog", {"stepsize": 0.5})
    job = task.Job(scene, str(tmp_path), str(tmp_path / "out"), TOOL, 1 << 20, 1)
    task._FORECAST_FROM, former = 1, task._FORECAST_FROM
    try:
        needs = task.bake(job)
    finally:
        task._FORECAST_FROM = former
    assert isinstance(needs, task.Needs) and needs.memory > 1 << 20
    assert not (tmp_path / "out").exists()
    larger = _larger(job, needs)
    assert larger.is_forecast and larger.memory > needs.memory and larger.threads == 1
    assert task.bake(larger)["status"] == "baked"
    with pytest.raises(Failure) as raised:
        _larger(job, task.Needs(1 << 40))
    assert raised.value.exit_code == 6


def test_a_cluster_that_is_not_there_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_TMPDIR", str(tmp_path))
    scenes = write(tmp_path / "scenes.jsonl", [{"input": "a.tar", "output": "a.mipvog"}])
    for address in ("auto", "127.0.0.1:9", "ray://127.0.0.1:9"):
        out = tmp_path / "out"
        assert main([str(scenes), "-o", str(out), "--address", address]) == 5
        words = capsys.readouterr().err
        assert words.startswith(f"error: found no Ray cluster at {address}; start one with")
        assert words.count("\n") == 1 and not out.exists()


def test_bad_manifests_and_programs_are_refused_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.jsonl"
    for line, found in [
        ("{", "found no JSON"),
        ("[]", "found list"),
        ('{"output": "a"}', "found input None"),
        ('{"input": "a", "output": "/a"}', "found output /a"),
        ('{"input": "a", "output": "../a"}', "found output ../a"),
        ('{"input": "a", "output": "s3://a"}', "found output s3://a"),
        ('{"input": "a", "output": "a", "option": {}}', "found key option"),
        ('{"input": "a", "output": "a", "options": []}', "found options []"),
    ]:
        path.write_text('{"input": "a", "output": "b"}\n' + line + "\n", encoding="utf-8")
        assert main([str(path), "-o", str(tmp_path / "out")]) == 3
        words = capsys.readouterr().err
        assert f"{path}: line 2: {found}" in words and "expected" in words
    path.write_text('{"input": "a", "output": "b"}\n' * 2, encoding="utf-8")
    assert main([str(path), "-o", str(tmp_path / "out")]) == 3
    assert main([str(tmp_path / "none.jsonl"), "-o", str(tmp_path / "out")]) == 5
    assert main([str(path), "-o", "x", "--program", "no-such-program"]) == 5
    assert not (tmp_path / "out").exists() and not ray.is_initialized()


def test_an_output_that_is_a_file_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], cluster: Cluster
) -> None:
    scenes = write(tmp_path / "scenes.jsonl", [{"input": "a.tar", "output": "a.mipvog"}])
    (tmp_path / "file").write_text("", encoding="utf-8")
    for out in (tmp_path / "file", tmp_path / "file/below"):
        assert main([str(scenes), "-o", str(out), "--address", cluster.address]) == 5
        words = capsys.readouterr().err
        assert (
            words == f"error: cannot write {out}: a file is there, expected a folder; name "
            "another place\n"
        )
    assert files(tmp_path) == {"scenes.jsonl", "file"}


def test_bad_options_fail_their_scene_alone(tmp_path: Path) -> None:
    from mipvog_bake.ray import task

    shutil.copy(SMALL, tmp_path / "a.npz")
    for options, code in [
        ({"stepsize": 0.5}, 0),
        ({"bit": 8}, 3),
        ({"bits": 99}, 2),
        ({"gltf": "a.glb"}, 2),
        ({"stepsize": 0.5, "mlp": "none"}, 0),
        # The network of a file beside the manifest.
        ({"stepsize": 0.5, "mlp": "a.npz"}, 0),
        ({"stepsize": 0.5, "mlp": "none.pt"}, 5),
        ({"stepsize": 0.5, "cameras": "none.json", "require_psnr": 30}, 5),
    ]:
        scene = manifest.Scene("a.npz", "a.mipvog", options)
        job = task.Job(scene, str(tmp_path), str(tmp_path / "out"), TOOL, 1 << 28, 1)
        result = task.bake(job)
        assert isinstance(result, dict) and result["exit_code"] == code, result
        assert bool(result["error"]) == bool(code)
    assert files(tmp_path / "out") == {"a.mipvog"}


def test_missing_inputs_end_without_a_process(tmp_path: Path) -> None:
    from mipvog_bake.ray import task

    shutil.copy(SMALL, tmp_path / "there.npz")
    scenes = [manifest.Scene(f"{name}.npz", f"{name}.mipvog") for name in ("there", "none")]
    jobs = [
        task.Job(scene, str(tmp_path), str(tmp_path / "out"), "no-such-program", 1 << 28, 1)
        for scene in scenes
    ]
    there, missing = task.look(jobs)
    assert there is None and missing is not None
    assert missing["status"] == "failed" and missing["exit_code"] == 5
    assert "none.npz: there is no such file" in missing["error"]


def test_a_program_that_crashes_is_a_result(tmp_path: Path) -> None:
    from mipvog_bake.ray import task

    crash = tmp_path / "crash"
    crash.write_text("#!/bin/sh\nkill -KILL $$\n", encoding="utf-8")
    crash.chmod(0o755)
    shutil.copy(SMALL, tmp_path / "a.npz")
    scene = manifest.Scene("a.npz", "a.mipvog")
    job = task.Job(scene, str(tmp_path), str(tmp_path / "out"), str(crash), 1 << 28, 1)
    result = task.bake(job)
    assert isinstance(result, dict) and result["exit_code"] == 137
    assert "SIGKILL" in result["error"]


def test_the_resident_program_bakes_again_after_it_was_killed(tmp_path: Path) -> None:
    from mipvog_bake.ray import resident

    source = ["bake", str(SMALL), "--stepsize", "0.5", "--quiet", "-o"]
    for number in range(3):
        code, _, words = resident.run([*source, str(tmp_path / f"{number}.mipvog")], tmp_path)
        assert (code, words) == (0, "")
        assert resident._process is not None
        if number == 0:
            first = resident._process.pid
        assert (resident._process.pid == first) == (number < 2)
        if number == 1:
            resident._process.kill()
            resident._process.wait()
    code, _, words = resident.run([*source, str(tmp_path / "0.mipvog")], tmp_path)
    assert code == 7 and "error" in words
    # A program that ends amid its work is a result, too.
    stop = threading.Timer(0.2, resident._process.kill)
    stop.start()
    slow = ["bake", str(TRAINED / "lego64/fine_last.tar"), "--filter", "fit", "-o"]
    assert resident.run([*slow, str(tmp_path / "slow.mipvog")], tmp_path)[0] == -9
    assert not (tmp_path / "slow.mipvog").exists()


def test_a_store_without_renames_gets_whole_files(tmp_path: Path) -> None:
    source = tmp_path / "file"
    source.write_bytes(b"whole")
    store.put(source, "memory://folder/file")
    assert store.exists("memory://folder/file") and store.size("memory://folder/file") == 5
    assert store.fetch("memory://folder/file", tmp_path / "in").read_bytes() == b"whole"
    with pytest.raises(Failure) as raised:
        store.fetch("memory://folder/none", tmp_path / "in")
    assert raised.value.exit_code == 5 and "no such file" in str(raised.value)
    with pytest.raises(Failure):
        store.size("nonsense://a/b")
