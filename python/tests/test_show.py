"""The viewer in notebooks."""

import json
import subprocess
import sys
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
        if tag == "iframe":
            self.found.append(dict(attrs))


def frame_of(text):
    parser = Frames()
    parser.feed(text)
    [frame] = parser.found
    return frame


def test_a_cell_shows_the_page_of_an_export(tmp_path):
    field = mipvog_bake.open(BAKED)
    view = field.show(300)
    frame = frame_of(view._repr_html_())
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


def test_a_notebook_that_jupyter_converts_holds_the_page(tmp_path):
    code = f"import mipvog_bake\nmipvog_bake.open({str(BAKED)!r}).show()"
    cell = {"cell_type": "code", "execution_count": None, "id": "a", "metadata": {}}
    cell |= {"outputs": [], "source": code}
    notebook = {"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
    (tmp_path / "show.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    words = [sys.executable, "-m", "jupyter", "nbconvert", "--to", "html", "--execute"]
    subprocess.run([*words, "show.ipynb"], cwd=tmp_path, check=True, capture_output=True)
    frame = frame_of((tmp_path / "show.html").read_text(encoding="utf-8"))
    assert frame["srcdoc"] == mipvog_bake.open(BAKED).show().page
