"""The viewer in notebooks."""

from html.parser import HTMLParser
from pathlib import Path

import pytest

import mipvog_bake

ROOT = Path(__file__).parents[2]
BAKED = ROOT / "fixtures" / "baked" / "tiny.rate.mipvog"
TRAINED = ROOT / "fixtures" / "trained" / "tiny" / "fine_last.tar"


class Frames(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        assert tag == "iframe"
        self.found.append(dict(attrs))


def frame_of(view):
    parser = Frames()
    parser.feed(view._repr_html_())
    [frame] = parser.found
    return frame


def test_a_cell_shows_the_page_of_an_export(tmp_path):
    field = mipvog_bake.open(BAKED)
    view = field.show(300)
    frame = frame_of(view)
    assert frame["srcdoc"] == view.page
    assert "height: 300px" in frame["style"]
    # Scripts of the page run, and see nothing of the notebook.
    assert frame["sandbox"] == "allow-scripts"
    output = tmp_path / "page.html"
    words = ["export", str(BAKED), "--to", "html", "-o", str(output)]
    assert mipvog_bake._native.main(["mipvog-bake", *words]) == 0
    assert output.read_text(encoding="utf-8") == view.page


def test_bytes_and_what_is_not_baked_are_shown():
    with mipvog_bake.open(BAKED.read_bytes()) as field:
        assert "<title>scene</title>" in field.show().page
    with pytest.warns(UserWarning):
        field = mipvog_bake.open(TRAINED)
    page = field.show().page
    assert page.startswith("<!doctype html>")
    assert "<title>scene</title>" in page
    field.close()
    with pytest.raises(mipvog_bake.Error, match="closed"):
        field.show()


def test_heights_that_are_none_are_refused():
    with pytest.raises(mipvog_bake.Error, match="height"):
        mipvog_bake.open(BAKED).show("tall")
