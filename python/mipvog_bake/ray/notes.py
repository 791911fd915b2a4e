"""What an output in a store was baked from: a digest in the object's own metadata.

A run that goes on would else fetch every input and every former output, only to find all of them
current. Sizes and tags of files, which a listing tells, are enough: a store gives other bytes
another tag. Where the digest is missing or another one, the program looks at the bytes.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any, Optional

from . import store


class Listings:
    """The files of folders, each asked for once."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, list[Any]]] = {}

    def state(self, name: str) -> Optional[list[Any]]:
        """Size and tag of a file; None for one that is not there, and for a folder."""
        folder, _, own = name.rpartition("/")
        if folder not in self._known:
            self._known[folder] = store.listing(folder)
        return self._known[folder].get(own)


def digest(program: str, options: dict[str, Any], states: dict[str, Any]) -> Optional[str]:
    """The digest of a program, its options, and its inputs by name, size and tag; None where a
    file has no tag."""
    if any(state is None or state[1] is None for state in states.values()):
        return None
    text = json.dumps([program, options, states], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
