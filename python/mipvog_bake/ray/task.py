"""Bakes a scene on a worker."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Optional, Union

from .._bake_options import INPUTS, OUTPUTS
from . import notes, program, store
from .failure import USAGE, Failure
from .manifest import Scene

# Inputs of fewer bytes are baked without a forecast: it would take as long as the bake.
_FORECAST_FROM = 16 << 20
# What the program finds beside an input: settings of the scene, and the coarse checkpoint.
_BESIDE = ("scene.toml", "scene.json", "args.json", "coarse_last.tar")
# Values of `mlp` that are no files.
_WORDS = ("auto", "none")


@dataclass(frozen=True)
class Job:
    """A scene, and the data that all workers need."""

    scene: Scene
    # The folder that the manifest's paths are relative to.
    folder: str
    # The folder of the outputs.
    output: str
    # The program, or the way to find it.
    program: Union[str, None]
    # Bytes of memory that are set aside for it; of these the forecast is not asked any more.
    memory: int
    threads: int
    is_forecast: bool = False

    def with_memory(self, memory: int, threads: int) -> Job:
        """The job with the memory of a forecast."""
        return replace(self, memory=memory, threads=threads, is_forecast=True)


@dataclass(frozen=True)
class Needs:
    """More memory than was reserved."""

    memory: int


def look(jobs: list[Job]) -> list[Optional[dict[str, Any]]]:
    """The results of scenes whose input is unreadable and of those that are up to date by their
    notes; None for the others."""
    listings = notes.Listings()
    return [_known(job, listings) for job in jobs]


def _known(job: Job, listings: notes.Listings) -> Optional[dict[str, Any]]:
    clock = time.monotonic()
    try:
        source, target = _names(job)
        if not (store.is_remote(source) and store.is_remote(target)):
            store.size(source)
            return None
        if listings.state(source) is None:
            # A folder, or nothing.
            store.size(source)
            return None
        noted = store.baked_from(target)
        if noted is None or noted[0] != _digest(job, listings):
            return None
        found = {"status": "current", "exit_code": 0, "output_bytes": noted[1]}
    except Failure as failure:
        found = failed(failure)
    return line(job.scene, found, time.monotonic() - clock)


def _names(job: Job) -> tuple[str, str]:
    """The input and the output of a scene."""
    return store.below(job.folder, job.scene.input), store.below(job.output, job.scene.output)


def _digest(job: Job, listings: notes.Listings) -> Optional[str]:
    """The digest of the inputs of a scene, by sizes and tags. Missing files beside the input are
    ignored; adding one later changes the digest."""
    source, _ = _names(job)
    states = {source: listings.state(source)}
    for name in _beside(source):
        found = listings.state(name)
        if found is not None:
            states[name] = found
    for name, value in job.scene.options.items():
        for file in _inputs(name, value):
            path = store.below(job.folder, file)
            # Files that are not in a store have no tags that all workers agree on.
            states[path] = listings.state(path) if store.is_remote(path) else None
    return notes.digest(program.version(job.program), job.scene.options, states)


def bake(job: Job) -> Union[dict[str, Any], Needs]:
    """Bakes a scene. Returns its result, a line of the report, or the memory that it needs."""
    clock = time.monotonic()
    try:
        found = _bake(job)
    except Failure as failure:
        found = failed(failure)
    if isinstance(found, Needs):
        return found
    return line(job.scene, found, time.monotonic() - clock)


def failed(failure: Failure) -> dict[str, Any]:
    """The result of a scene that could not be baked."""
    return {"status": "failed", "exit_code": failure.exit_code, "error": failure.message}


def line(scene: Scene, found: dict[str, Any], seconds: float) -> dict[str, Any]:
    """A line of the report."""
    return {
        "input": scene.input,
        "output": scene.output,
        "status": found["status"],
        "exit_code": found["exit_code"],
        "seconds": round(seconds, 6),
        "output_bytes": found.get("output_bytes"),
        "psnr": found.get("psnr"),
        "sha256": found.get("sha256"),
        "warnings": found.get("warnings", []),
        "error": found.get("error"),
    }


def _bake(job: Job) -> Union[dict[str, Any], Needs]:
    scene = job.scene
    for name in scene.options:
        if name.replace("-", "_") in OUTPUTS:
            message = f"option {name} writes another file; make it from the container afterwards"
            raise Failure(message, USAGE)
    source, target = _names(job)
    size = store.size(source)
    tool = program.find(job.program)
    with tempfile.TemporaryDirectory(prefix="mipvog-bake-") as folder:
        scratch = Path(folder)
        is_remote = store.is_remote(target)
        output = scratch / "output.mipvog" if is_remote else Path(store.local_path(target))
        # As they are before they are read: what changes meanwhile is baked again the next time.
        in_store = is_remote and store.is_remote(source)
        note = _digest(job, notes.Listings()) if in_store else None
        options = {
            name: _staged_option(name, value, job, scratch) for name, value in scene.options.items()
        }
        words = {
            "input": str(_staged(source, scratch / "input")),
            "output": str(output),
            "options": options,
        }
        threads = f"--threads={job.threads}"
        if size >= _FORECAST_FROM and not job.is_forecast:
            forecast, _ = program.bake(tool, words, scratch, threads, "--dry-run")
            # What cannot be forecast is baked with the memory that all scenes have.
            needed = forecast.get("peak_memory_bytes") or 0
            if needed > job.memory:
                return Needs(needed)
        if is_remote and store.exists(target):
            # The program tells from the container whether anything has changed.
            store.fetch(target, scratch / "former").rename(output)
        found, _ = program.bake(tool, words, scratch, threads, "--if-changed")
        if is_remote and found["status"] == "baked":
            store.put(output, target, note)
        if found.get("error"):
            # Users know their own names, and not the worker's.
            found["error"] = _named(found["error"], words, {"input": source, "output": target})
        return found


def _named(error: str, words: dict[str, Any], names: dict[str, str]) -> str:
    for key, name in names.items():
        error = error.replace(words[key], name)
    return error


def _staged(source: str, folder: Path) -> Path:
    """The local path of an input. Files of a store are copied to the worker's disk, with the
    settings beside them."""
    if not store.is_remote(source):
        return Path(store.local_path(source))
    local = store.fetch(source, folder)
    there = store.listing(store.parent(source))
    for beside in _beside(source):
        if beside.rsplit("/", 1)[-1] in there:
            store.fetch(beside, folder)
    return local


def _beside(source: str) -> list[str]:
    """The names of files that the program looks for beside an input."""
    folder, _, own = source.rpartition("/")
    names = (*_BESIDE, f"{own.rsplit('.', 1)[0]}.args.json")
    return [f"{folder}/{name}" for name in names if name != own]


def _inputs(name: str, value: Any) -> list[str]:
    """The input files that an option names; none for most options."""
    option = name.replace("-", "_")
    is_word = option == "mlp" and value in _WORDS
    values = value if isinstance(value, (list, tuple)) else [value]
    are_names = all(isinstance(one, str) for one in values)
    return list(values) if option in INPUTS and are_names and not is_word else []


def _staged_option(name: str, value: Any, job: Job, scratch: Path) -> Any:
    files = [
        str(_staged(store.below(job.folder, file), scratch / name / str(number)))
        for number, file in enumerate(_inputs(name, value))
    ]
    if not files:
        return value
    return files if isinstance(value, (list, tuple)) else files[0]
