"""Outputs in a store that speaks S3 and fails two requests in ten."""

from __future__ import annotations

import http.client
import itertools
import json
import os
import shutil
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

pytest.importorskip("ray")
pytest.importorskip("s3fs")
pytest.importorskip("moto.server")

import ray  # noqa: E402
from moto.server import ThreadedMotoServer  # noqa: E402

from mipvog_bake.ray import program, store  # noqa: E402
from mipvog_bake.ray.__main__ import main  # noqa: E402
from mipvog_bake.ray.failure import Failure  # noqa: E402

SMALL = Path(__file__).resolve().parents[2] / "fixtures/trained/dvgo/flat.npz"
DENIED = b'<?xml version="1.0"?><Error><Code>AccessDenied</Code><Message>no</Message></Error>'

try:
    program.find(None)
except Failure:
    pytest.skip("no program mipvog-bake here", allow_module_level=True)


class Proxy(ThreadingHTTPServer):
    """Stands before a server, fails the third and the seventh of ten requests, and keeps a bucket
    closed."""

    daemon_threads = True

    def __init__(self, host: str, port: int) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.behind = (host, port)
        self.numbers = itertools.count(1)
        self.failed = 0


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Proxy

    def log_message(self, format: str, *arguments: object) -> None:
        pass

    def answer(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        if self.path.startswith("/closed"):
            self.reply(403, {"Content-Type": "application/xml"}, DENIED)
        elif next(self.server.numbers) % 10 in (3, 7):
            self.server.failed += 1
            self.reply(503, {}, b"")
        else:
            behind = http.client.HTTPConnection(*self.server.behind)
            behind.request(self.command, self.path, body, dict(self.headers))
            answer = behind.getresponse()
            headers = {
                name: value
                for name, value in answer.getheaders()
                if name.lower() not in ("transfer-encoding", "connection", "date", "server")
            }
            self.reply(answer.status, headers, answer.read())
            behind.close()

    def reply(self, status: int, headers: dict[str, str], body: bytes) -> None:
        self.send_response(status)
        length = {"Content-Length": str(len(body))}
        for name, value in (length | headers).items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    do_GET = do_PUT = do_POST = do_DELETE = do_HEAD = answer


@pytest.fixture
def proxy(monkeypatch: pytest.MonkeyPatch) -> Iterator[Proxy]:
    behind = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    behind.start()
    proxy = Proxy(*behind.get_host_and_port())
    threading.Thread(target=proxy.serve_forever, daemon=True).start()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{proxy.server_port}",
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():
        monkeypatch.setenv(name, value)
    import s3fs

    # A store of a former test has another address.
    s3fs.S3FileSystem.clear_instance_cache()
    s3fs.S3FileSystem().makedirs("s3://scenes", exist_ok=True)
    yield proxy
    ray.shutdown()
    proxy.shutdown()
    behind.stop()


def test_every_scene_gets_into_a_store_that_fails_now_and_then(
    tmp_path: Path, proxy: Proxy
) -> None:
    import s3fs

    shutil.copy(SMALL, tmp_path / "sound.npz")
    (tmp_path / "cut.npz").write_bytes(SMALL.read_bytes()[:9000])
    remote = s3fs.S3FileSystem()
    store.put(SMALL, "s3://scenes/in/remote.npz")
    (tmp_path / "scene.json").write_text('{"stepsize": 0.5}', encoding="utf-8")
    store.put(tmp_path / "scene.json", "s3://scenes/in/scene.json")
    inputs = ["sound.npz", "s3://scenes/in/remote.npz", "cut.npz", "s3://scenes/in/none.npz"]
    lines = [
        {
            "input": inputs[number % 4],
            "output": f"{number}.mipvog",
            "options": {"bits": 4 + number // 4},
        }
        for number in range(24)
    ]
    manifest = tmp_path / "scenes.jsonl"
    manifest.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    report = tmp_path / "report.jsonl"
    arguments = [str(manifest), "-o", "s3://scenes/out", "--report", str(report)]
    assert main(arguments) == 1
    assert proxy.failed >= 10
    results = {}
    for line in report.read_text(encoding="utf-8").splitlines():
        result = json.loads(line)
        results[int(result["output"].split(".")[0])] = result
    found = {os.path.basename(name) for name in remote.ls("s3://scenes/out", refresh=True)}
    assert found == {f"{number}.mipvog" for number in range(24) if number % 4 < 2}
    for number in range(0, 24, 4):
        first, second = (
            store.fetch(f"s3://scenes/out/{n}.mipvog", tmp_path / "back").read_bytes()
            for n in (number, number + 1)
        )
        assert first == second and len(first) == results[number]["output_bytes"]
        assert [results[number + n]["status"] for n in range(4)] == ["baked"] * 2 + ["failed"] * 2
        assert [results[number + n]["exit_code"] for n in (2, 3)] == [3, 5]
        assert "there is no such file" in results[number + 3]["error"]
    # What is there stays as it is.
    before = {name: remote.info(f"s3://scenes/out/{name}", refresh=True) for name in found}
    assert main(arguments) == 1
    states = [json.loads(line)["status"] for line in report.read_text("utf-8").splitlines()]
    assert (states.count("current"), states.count("failed")) == (12, 12)
    after = {name: remote.info(f"s3://scenes/out/{name}", refresh=True) for name in found}
    assert {n: i["LastModified"] for n, i in before.items()} == {
        n: i["LastModified"] for n, i in after.items()
    }


def test_a_bucket_without_permission_is_one_sentence(
    tmp_path: Path, proxy: Proxy, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = tmp_path / "scenes.jsonl"
    manifest.write_text('{"input": "a.npz", "output": "a.mipvog"}\n', encoding="utf-8")
    assert main([str(manifest), "-o", "s3://closed/out"]) == 5
    words = capsys.readouterr().err
    assert words.startswith("error: cannot write s3://closed/out: the store gives no permission;")
    assert words.count("\n") == 1
    assert main(["s3://closed/scenes.jsonl", "-o", str(tmp_path / "out")]) == 5
    words = capsys.readouterr().err
    assert words.startswith("error: cannot read s3://closed/scenes.jsonl: the store gives no perm")
    assert words.count("\n") == 1 and not (tmp_path / "out").exists()


def test_an_input_without_permission_fails_its_scene_alone(tmp_path: Path, proxy: Proxy) -> None:
    shutil.copy(SMALL, tmp_path / "sound.npz")
    manifest, report = tmp_path / "scenes.jsonl", tmp_path / "report.jsonl"
    lines = [
        {"input": "s3://closed/a.npz", "output": "a.mipvog"},
        {"input": "sound.npz", "output": "b.mipvog", "options": {"stepsize": 0.5}},
    ]
    manifest.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    assert main([str(manifest), "-o", str(tmp_path / "out"), "--report", str(report)]) == 1
    results = {
        result["output"]: result
        for result in map(json.loads, report.read_text(encoding="utf-8").splitlines())
    }
    refused = results["a.mipvog"]
    assert (refused["status"], refused["exit_code"]) == ("failed", 5)
    assert "cannot read s3://closed/a.npz: the store gives no permission" in refused["error"]
    assert results["b.mipvog"]["status"] == "baked"
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["b.mipvog"]


def test_scenes_of_a_store_are_merged_and_change_with_each_of_them(
    tmp_path: Path, proxy: Proxy
) -> None:
    store.put(SMALL, "s3://scenes/in/a.npz")
    store.put(SMALL, "s3://scenes/in/b.npz")
    store.put(SMALL, "s3://scenes/in/more/c.npz")
    options = {"stepsize": 0.5, "merge": ["b.npz", "more/c.npz"]}
    (tmp_path / "scenes.jsonl").write_text(
        json.dumps({"input": "a.npz", "output": "all.mipvog", "options": options}),
        encoding="utf-8",
    )
    store.put(tmp_path / "scenes.jsonl", "s3://scenes/in/scenes.jsonl")
    report = tmp_path / "report.jsonl"
    arguments = ["s3://scenes/in/scenes.jsonl", "-o", "s3://scenes/out", "--report", str(report)]

    def status() -> str:
        assert main(arguments) == 0, report.read_text("utf-8")
        return str(json.loads(report.read_text("utf-8"))["status"])

    assert (status(), status()) == ("baked", "current")
    changed = tmp_path / "c.npz"
    changed.write_bytes((SMALL.parent / "flat_compressed.npz").read_bytes())
    store.put(changed, "s3://scenes/in/more/c.npz")
    assert status() != "current"
