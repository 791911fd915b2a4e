"""The program in the wheel."""

import signal
import subprocess
import sys
from pathlib import Path

import mipvog_bake

PROGRAM = Path(sys.executable).with_name("mipvog-bake")


def run(*arguments):
    return subprocess.run(arguments, capture_output=True, text=True, check=False)


def test_the_program_is_in_the_environment(tmp_path):
    version = run(PROGRAM, "version")
    assert version.stdout.split()[:2] == ["mipvog-bake", mipvog_bake.__version__]
    assert run(sys.executable, "-m", "mipvog_bake", "version").stdout == version.stdout
    missing = run(PROGRAM, "bake", tmp_path / "none.tar", "-o", tmp_path / "a.mipvog")
    assert missing.returncode == 5 and "none.tar" in missing.stderr
    assert run(PROGRAM, "bake", "--bits").returncode == 2
    assert "bake" in run(PROGRAM, "--help").stdout


def test_files_bake_to_the_bytes_of_the_program(tmp_path):
    trained = Path(__file__).parents[2] / "fixtures" / "trained" / "tiny" / "fine_last.tar"
    assert run(PROGRAM, "bake", trained, "-o", tmp_path / "a.mipvog").returncode == 0
    report = mipvog_bake.bake(trained, tmp_path / "b.mipvog", limit={"memory": 1 << 30}, threads=1)
    assert (tmp_path / "a.mipvog").read_bytes() == (tmp_path / "b.mipvog").read_bytes()
    assert report["output_bytes"] == (tmp_path / "b.mipvog").stat().st_size


def test_an_interrupt_ends_the_program_without_a_traceback(tmp_path):
    trained = Path(__file__).parents[2] / "fixtures" / "trained" / "tiny" / "fine_last.tar"
    baked = tmp_path / "a.mipvog"
    assert run(PROGRAM, "bake", trained, "-o", baked).returncode == 0
    with subprocess.Popen(
        [PROGRAM, "view", baked, "--no-open"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as served:
        address = served.stdout.readline()
        served.send_signal(signal.SIGINT)
        more, words = served.communicate(timeout=60)
    assert b"127.0.0.1" in address and not more, (address, more)
    # A server ends when somebody asks it to: that is no error.
    assert b"Traceback" not in words and served.returncode == 0, words
