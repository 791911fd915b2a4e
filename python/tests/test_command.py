"""The command for scenes of nerfstudio, and the example of NumPy, without torch."""

import subprocess
import sys
from pathlib import Path

from scenes import night

import mipvog_bake
from mipvog_bake import nerfstudio as command

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_the_command_says_what_it_misses(tmp_path, monkeypatch, capsys):
    output = tmp_path / "scene.mipvog"
    assert command.main([str(tmp_path / "none.yml"), "-o", str(output)]) == 5
    assert "none.yml: found no such file" in capsys.readouterr().err
    (tmp_path / "config.yml").write_text("a training")
    # None in the table of modules is a package that is not there.
    monkeypatch.setitem(sys.modules, "nerfstudio", None)
    assert command.main([str(tmp_path / "config.yml"), "-o", str(output)]) == 2
    assert "found no nerfstudio" in capsys.readouterr().err
    assert not output.exists()


@night
def test_the_example_of_numpy_runs(tmp_path):
    output = tmp_path / "ball.mipvog"
    words = [sys.executable, EXAMPLES / "from_numpy.py", output]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    field = mipvog_bake.open(output)
    assert field.dimensions == (96, 96, 96)
    assert field.sample([[0, 0, 0]])["opacity"][0] > 0.1
