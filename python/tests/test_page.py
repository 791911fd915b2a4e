"""The programs of the book's page run, one after the other, in a folder with the fixture scene."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python (\S+)\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("name, text", BLOCKS, ids=[name for name, _ in BLOCKS])
def test_programs_of_the_page_run(name, text, tmp_path):
    shutil.copy(ROOT / "fixtures" / "trained" / "lego64" / "fine_last.tar", tmp_path)
    (tmp_path / name).write_text(text, encoding="utf-8")
    words = [sys.executable, "-W", "error", name]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_script_of_arrays_is_short():
    lines = dict(BLOCKS)["arrays.py"].splitlines()
    assert len([line for line in lines if line]) <= 15
