"""Fields in notebooks: the viewer's page in a frame, without a server."""

from __future__ import annotations

import os
import tempfile
from html import escape
from typing import TYPE_CHECKING, Union

from . import _native, _options
from ._progress import Progress, shown

if TYPE_CHECKING:
    from ._field import Field


class View:
    """A frame with the viewer, which a notebook displays as the result of a cell.

    The frame contains the page and the field, so the notebook shows both wherever it is opened. The
    page is isolated from the notebook: its scripts have no access to it.
    """

    def __init__(self, page: str, height: int) -> None:
        self.page = page
        """The page, a document of HTML."""
        self.height = height
        """Pixels of the frame."""

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {self.height}px; border: 0"
        page = escape(self.page)
        return (
            f'<iframe title="mipvog-bake" style="{style}" sandbox="allow-scripts" '
            f'allow="fullscreen; xr-spatial-tracking" srcdoc="{page}"></iframe>'
        )

    def __repr__(self) -> str:
        return f"<mipvog_bake.View: {len(self.page) / 1e6:.1f} MB>"


def page_of(field: Field, progress: Union[None, bool, Progress]) -> str:
    """The viewer's page with a field. A field that is not baked is baked first."""
    from ._bake import bake

    with tempfile.TemporaryDirectory(prefix="mipvog-bake-") as folder:
        source, options = os.path.join(folder, "scene.mipvog"), {}
        if field.model != "baked" or field._arrays is not None:
            bake(field, source, progress=progress)
        elif field._data is not None:
            options = field._options
            with open(source, "wb") as file:
                file.write(field._data)
        else:
            options = field._options
            source = field._path or ""
        page = os.path.join(folder, "page.html")
        words = _options.words("export", options)
        arguments = ["export", "--quiet", "--progress=never", *words]
        with shown(progress) as callback:
            _native.call([*arguments, f"--output={page}", "--", source], progress=callback)
        with open(page, encoding="utf-8") as file:
            return file.read()
