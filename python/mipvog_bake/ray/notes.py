"""Records the inputs of an output in a store: a digest in the metadata of the object.

Without it, a resumed run would fetch every input and every earlier output, only to find that all
are up to date. Sizes and tags of files, which a listing contains, suffice: a store gives changed
bytes a new tag. If the digest is missing or different, the program compares the bytes.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any, Optional

from . import store


class Listings:
    """The files of folders, each listed once."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, list[Any]]] = {}

    def state(self, name: str) -> Optional[list[Any]]:
        """Size and tag of a file; None for a missing file and for a folder."""
        folder, _, own = name.rpartition("/")
        if folder not in self._known:
            self._known[folder] = store.listing(folder)
        return self._known[folder].get(own)


def digest(program: str, options: dict[str, Any], states: dict[str, Any]) -> Optional[str]:
    """The digest of a program, its options, and its inputs by name, size and tag. None if a file
    has no tag."""
    if any(state is None or state[1] is None for state in states.values()):
        return None
    text = json.dumps([program, options, states], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
