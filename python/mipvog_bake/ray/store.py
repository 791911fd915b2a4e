"""Files on local disks and in the stores that fsspec supports, such as `s3://` and `gs://`."""

from __future__ import annotations

import os
import stat
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Optional, TypeVar

import fsspec
from fsspec.core import url_to_fs

from .failure import INPUT_OUTPUT, USAGE, Failure

Result = TypeVar("Result")

# Tries of a request that the store failed, and seconds before the second one; twice as long before
# each later one.
_TRIES, _PAUSE = 6, 0.25
# Stores in which a file appears whole: a put that fails leaves nothing.
_ATOMIC = {"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "oss", "memory"}
# Stores whose files carry metadata that these calls read and write, and the name of ours.
_NOTED = {"s3", "s3a"}
_NOTE = "mipvog-inputs"
# Errors that another try does not mend.
_IN_THE_WAY = (FileExistsError, NotADirectoryError)
_PERMANENT = (FileNotFoundError, PermissionError, IsADirectoryError, *_IN_THE_WAY)


def is_remote(name: str) -> bool:
    """True for a URI, unless it names a local file."""
    return "://" in name and not name.startswith("file://")


def local_path(name: str) -> str:
    """The absolute path of a local name."""
    return os.path.abspath(name.removeprefix("file://"))


def parent(name: str) -> str:
    """The folder of a file."""
    return name.rsplit("/", 1)[0] if is_remote(name) else os.path.dirname(local_path(name))


def below(folder: str, name: str) -> str:
    """A name relative to a folder, unless it is a URI or absolute."""
    if "://" in name or os.path.isabs(name):
        found = name
    else:
        found = f"{folder.rstrip('/')}/{name}" if is_remote(folder) else os.path.join(folder, name)
    if is_remote(found) and ".." in found.split("/"):
        # A key is no path: stores and clients disagree on where it leads.
        raise Failure(f"{found}: found '..' in a key, expected a plain one; name the file", USAGE)
    return found


def read_lines(name: str) -> Iterator[str]:
    """The lines of a text file."""
    place = name if is_remote(name) else local_path(name)
    text = fsspec.open(place, mode="rt", encoding="utf-8")
    with _tried("read", name, text.open) as file:
        try:
            yield from file
        except UnicodeDecodeError as error:
            raise Failure(f"{name}: found no UTF-8, expected JSON lines", 3) from error


def size(name: str) -> int:
    """The size of an input in bytes; 0 for a folder."""
    if not is_remote(name):
        found = _tried("read", name, lambda: os.stat(local_path(name)))
        return found.st_size if stat.S_ISREG(found.st_mode) else 0
    info = _with_store("read", name, lambda store, path: store.info(path))
    return int(info.get("size") or 0)


def exists(name: str) -> bool:
    """True if the file exists."""
    if not is_remote(name):
        return os.path.exists(local_path(name))
    return _with_store("read", name, lambda store, path: bool(store.exists(path)))


def _state(info: dict[str, Any]) -> list[Any]:
    """Size and tag of a file, from the store's information."""
    names = ("ETag", "etag", "md5Hash", "LastModified", "last_modified", "updated", "mtime")
    tags = [info[name] for name in (*names, "created") if info.get(name) is not None]
    return [info.get("size"), str(tags[0]) if tags else None]


def baked_from(name: str) -> Optional[tuple[str, int]]:
    """The digest that `put` recorded with a file, and the size of the file; None without a
    digest."""

    def look(store: Any, path: str) -> Optional[tuple[str, int]]:
        if not _names(store) & _NOTED:
            return None
        try:
            size = store.info(path).get("size")
            found = store.metadata(path).get(_NOTE)
        except FileNotFoundError:
            return None
        return None if found is None else (str(found), int(size))

    return _with_store("read", name, look)


def listing(folder: str) -> dict[str, list[Any]]:
    """Size and tag of each file in a folder of a store, by name, in one request."""

    def look(store: Any, path: str) -> dict[str, list[Any]]:
        try:
            found = store.ls(path, detail=True)
        except FileNotFoundError:
            return {}
        files = (info for info in found if info.get("type") == "file")
        return {info["name"].rsplit("/", 1)[-1]: _state(info) for info in files}

    return _with_store("read", folder, look)


def fetch(name: str, folder: Path) -> Path:
    """Copies a file or folder from a store into a local folder."""
    target = folder / name.rstrip("/").rsplit("/", 1)[-1]

    def get(store: Any, path: str) -> None:
        if store.isdir(path):
            if any(".." in key.split("/") for key in store.find(path)):
                raise Failure(f"{name}: found '..' in a key, expected plain ones", USAGE)
            store.get(path.rstrip("/") + "/", f"{target}/", recursive=True)
        else:
            store.get_file(path, str(target))

    folder.mkdir(parents=True, exist_ok=True)
    _with_store("read", name, get)
    return target


def put(file: Path, name: str, note: Optional[str] = None) -> None:
    """Copies a local file into a store, where it appears completely or not at all. Stores that
    support metadata also record a note."""

    def copy(store: Any, path: str) -> None:
        if _names(store) & _ATOMIC:
            noted = note is not None and _names(store) & _NOTED
            store.put_file(str(file), path, **({"Metadata": {_NOTE: note}} if noted else {}))
        else:
            store.makedirs(path.rsplit("/", 1)[0], exist_ok=True)
            part = f"{path}.{uuid.uuid4().hex}.partial"
            try:
                store.put_file(str(file), part)
                store.mv(part, path)
            except BaseException:
                if store.exists(part):
                    store.rm(part)
                raise
        found = store.info(path).get("size")
        if found != file.stat().st_size:
            raise OSError(f"found {found} bytes after writing {file.stat().st_size}")

    _with_store("write", name, copy)


def check_output(folder: str) -> None:
    """Refuses a folder that is not writable: writes a test file there and removes it."""
    if not is_remote(folder):
        path = local_path(folder)
        _tried("write", folder, lambda: os.makedirs(path, exist_ok=True))
        if not os.access(path, os.W_OK):
            raise Failure(_sentence("write", folder, PermissionError()), INPUT_OUTPUT)
        return
    name = below(folder, f".mipvog-bake-{uuid.uuid4().hex}")

    def probe(store: Any, path: str) -> None:
        store.pipe_file(path, b"mipvog-bake")
        store.rm_file(path)

    _with_store("write", name, probe, shown=folder)


def _names(store: Any) -> set[str]:
    protocol = store.protocol
    return {protocol} if isinstance(protocol, str) else set(protocol)


def _with_store(
    verb: str, name: str, work: Callable[[Any, str], Result], shown: str = ""
) -> Result:
    try:
        store, path = url_to_fs(name, use_listings_cache=False)
    except ImportError as error:
        message = f"cannot {verb} {shown or name}: {error}"
        raise Failure(message, USAGE) from error
    except ValueError as error:
        known = "expected a local path or a URI such as s3://bucket/folder"
        raise Failure(f"cannot {verb} {shown or name}: {error}; {known}", USAGE) from error
    return _tried(verb, shown or name, lambda: work(store, path))


def _tried(verb: str, name: str, work: Callable[[], Result]) -> Result:
    """Repeats work after a failure of the store that may be temporary."""
    pause = _PAUSE
    for tries in range(1, _TRIES + 1):
        try:
            return work()
        except _PERMANENT as error:
            raise Failure(_sentence(verb, name, error), INPUT_OUTPUT) from error
        except (UnicodeDecodeError, Failure):
            raise
        except Exception as error:
            # Stores raise errors of their own, also such as are no OSError.
            if tries == _TRIES or _is_refusal(error):
                raise Failure(_sentence(verb, name, error), INPUT_OUTPUT) from error
        time.sleep(pause)
        pause *= 2
    raise AssertionError("the last try returns or raises")


def _is_refusal(error: Exception) -> bool:
    words = f"{type(error).__name__} {error}"
    return any(
        word in words for word in ("Credentials", "AccessDenied", "Forbidden", "NoSuchBucket")
    )


def _sentence(verb: str, name: str, error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return f"cannot {verb} {name}: there is no such file or bucket; check the name"
    if isinstance(error, _IN_THE_WAY):
        return f"cannot {verb} {name}: a file is there, expected a folder; name another place"
    if isinstance(error, PermissionError) or _is_refusal(error):
        return (
            f"cannot {verb} {name}: the store gives no permission; give the workers credentials "
            "that may, or name another place"
        )
    words = " ".join(str(error).split()) or type(error).__name__
    return f"cannot {verb} {name}: {words}; check the store and the network, then run again"
