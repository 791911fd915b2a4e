"""Keeps scenes in flight on a cluster and writes the report."""

from __future__ import annotations

import json
import logging
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any, Optional, Union

import ray
from ray.exceptions import RayError, RayTaskError

from . import manifest, store, task
from .failure import INPUT_OUTPUT, LIMIT, Failure
from .task import Job, Needs

# Memory that is set aside for a scene before a forecast has told its own.
_MEMORY = 256 << 20
# A forecast tells the typical need; this much of it is set aside.
_MARGIN = 1.2
# Tries of a scene whose worker was lost.
_RETRIES = 5
# Tasks in flight for each core, and at least: enough that no core waits for the driver.
_IN_FLIGHT, _LEAST_IN_FLIGHT = 3, 16
# Scenes whose inputs one task looks for: a missing input costs no task of its own.
_LOOKED_FOR = 32
# Seconds between two looks at the size of the cluster.
_LOOK = 5.0
# Seconds to reach a cluster.
_REACH = 10.0

# Ray gives these functions no types.
_resources: Callable[[], dict[str, float]] = ray.cluster_resources
_nodes: Callable[[], list[dict[str, Any]]] = ray.nodes


@dataclass(frozen=True)
class Options:
    """What to bake, and where."""

    # Path or URI of the manifest.
    manifest: str
    # Folder or URI of the outputs.
    output: str
    # `auto`, `host:port` or `ray://host:port` of a cluster; None starts one of this machine.
    address: Optional[str] = None
    # The program on the workers; None finds it.
    program: Optional[str] = None


def bake_all(options: Options, tell: Callable[[dict[str, Any]], None]) -> int:
    """Bakes all scenes of a manifest, reports each result as it arrives, and returns the number of
    failed scenes."""
    manifest.check(options.manifest)
    _connect(options.address)
    output = options.output if store.is_remote(options.output) else store.local_path(options.output)
    _raise_of_worker(_remote(_check_output).remote(output))
    folder = manifest.folder(options.manifest)
    jobs = (
        Job(scene, folder, output, options.program, _MEMORY, 1)
        for scene in manifest.read(options.manifest)
    )
    return _drive(jobs, tell)


def _check_output(output: str) -> Optional[Failure]:
    try:
        store.check_output(output)
    except Failure as failure:
        return failure
    return None


def _raise_of_worker(reference: Any) -> None:
    failure = ray.get(reference)
    if failure is not None:
        raise failure


def _remote(work: Callable[..., Any], **resources: Any) -> Any:
    """A task that Ray retries if its worker is lost, but not if it fails."""
    options = {"num_cpus": 1, "max_retries": _RETRIES, "retry_exceptions": False, **resources}
    return ray.remote(**options)(work)


def _connect(address: Optional[str]) -> None:
    if ray.is_initialized():
        return
    _reach(address)
    try:
        ray.init(
            address=address,
            log_to_driver=False,
            logging_level=logging.ERROR,
            ignore_reinit_error=True,
        )
    except (RayError, OSError, RuntimeError, ValueError) as error:
        raise Failure(_no_cluster(address or "this machine"), INPUT_OUTPUT) from error


def _reach(address: Optional[str]) -> None:
    """Refuses a host and port without a listener, which Ray would try to reach for minutes."""
    host, _, port = (address or "").removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        return
    try:
        socket.create_connection((host, int(port)), timeout=_REACH).close()
    except OSError as error:
        raise Failure(_no_cluster(address or ""), INPUT_OUTPUT) from error


def _no_cluster(address: str) -> str:
    return (
        f"found no Ray cluster at {address}; start one with `ray start --head`, name its address, "
        "or leave --address out to use this machine alone"
    )


def _drive(jobs: Iterator[Job], tell: Callable[[dict[str, Any]], None]) -> int:
    look, bake = _remote(task.look), _remote(task.bake, memory=_MEMORY)
    flying: dict[Any, Union[Job, list[Job]]] = {}
    # Scenes whose input is there.
    waiting: deque[Job] = deque()
    failed, most, looked = 0, _LEAST_IN_FLIGHT, 0.0
    while True:
        if time.monotonic() - looked > _LOOK:
            looked = time.monotonic()
            cores = _resources().get("CPU", 1)
            most = max(_LEAST_IN_FLIGHT, int(_IN_FLIGHT * cores))
        while len(flying) < most and waiting:
            job = waiting.popleft()
            flying[bake.remote(job)] = job
        while len(flying) < most and (several := list(islice(jobs, _LOOKED_FOR))):
            flying[look.remote(several)] = several
        if not flying:
            return failed
        # One by one would be a round trip each: all that are ready are taken.
        ray.wait(list(flying), num_returns=1, timeout=_LOOK, fetch_local=False)
        ready, _ = ray.wait(list(flying), num_returns=len(flying), timeout=0, fetch_local=False)
        for reference in ready:
            work = flying.pop(reference)
            if isinstance(work, list):
                found = _looked_for(reference, work)
                waiting.extend(one for one in found if isinstance(one, Job))
            else:
                found = [_result(reference, work)]
                for larger in (one for one in found if isinstance(one, Job)):
                    options = {"num_cpus": larger.threads, "memory": larger.memory}
                    flying[bake.options(**options).remote(larger)] = larger
            for result in (one for one in found if not isinstance(one, Job)):
                failed += result["status"] == "failed"
                tell(result)


def _looked_for(reference: Any, jobs: list[Job]) -> list[Union[dict[str, Any], Job]]:
    """The jobs whose input exists, and the results of the others."""
    try:
        missing = _answer(reference)
        return [
            job if result is None else result for job, result in zip(jobs, missing, strict=True)
        ]
    except Failure as failure:
        return [task.line(job.scene, task.failed(failure), 0.0) for job in jobs]


def _result(reference: Any, job: Job) -> Union[dict[str, Any], Job]:
    """The result of a scene, or its job with more memory."""
    try:
        answer: Union[dict[str, Any], Needs] = _answer(reference)
        return _larger(job, answer) if isinstance(answer, Needs) else answer
    except Failure as failure:
        return task.line(job.scene, task.failed(failure), 0.0)


def _answer(reference: Any) -> Any:
    try:
        return ray.get(reference)
    except RayTaskError as error:
        message = f"the worker failed: {error.cause!r}; report this"
        raise Failure(message, INPUT_OUTPUT) from error
    except RayError as error:
        words = str(error).split("\n", 1)[0]
        message = f"its worker was lost {_RETRIES + 1} times ({words}); run again"
        raise Failure(message, INPUT_OUTPUT) from error


def _larger(job: Job, needs: Needs) -> Job:
    """A job with the memory that a forecast requires, and the same share of a node's cores."""
    memory = int(needs.memory * _MARGIN)
    nodes = [node["Resources"] for node in _nodes() if node["Alive"]]
    fitting = [node for node in nodes if node.get("memory", 0) >= memory and node.get("CPU", 0)]
    if not fitting:
        largest = max((int(node.get("memory", 0)) for node in nodes), default=0)
        message = (
            f"needs {memory} bytes of memory, and the largest node has {largest}; give the scene "
            "the option memory, or add a larger node"
        )
        raise Failure(message, LIMIT)
    node = min(fitting, key=lambda node: node["memory"])
    share = memory / node["memory"]
    return job.with_memory(memory, max(1, int(share * node["CPU"])))


def dumps(result: dict[str, Any]) -> str:
    """A result as a line of JSON."""
    return json.dumps(result, ensure_ascii=False) + "\n"
