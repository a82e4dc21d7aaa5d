"""Standard output that is closed, or full."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.helpers import shapes
from tests.helpers.commands import COMMAND, export

needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is missing")


def shell(line: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: S602
        f"'{COMMAND}' {line}",
        check=False, capture_output=True, text=True, shell=True, cwd=cwd,
        env={**os.environ, **environment},
    )  # fmt: skip


@pytest.mark.slow
def test_a_closed_output_discards_what_is_printed(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((0.04, 0.06, 0.08)))
    words = "box.stl --max-edge inf"
    run = shell(f"label {words} >&-", tmp_path)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
    assert (tmp_path / "box_labeled.ply").read_bytes().startswith(b"ply\n")
    run = shell("label box.stl --best 0 >&-", tmp_path)
    assert (run.returncode, run.stderr.count("\n")) == (2, 1)
    assert shell("label box.stl --best 0 >&- 2>&-", tmp_path).returncode == 2


@pytest.mark.slow
@needs_full
@pytest.mark.parametrize("words", ["label box.stl --best 0", "design --nothing"])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_standard_error_leaves_the_exit_code(
    tmp_path: Path, words: str, unbuffered: str
) -> None:
    run = shell(f"{words} 2> /dev/full", tmp_path, PYTHONUNBUFFERED=unbuffered)
    assert (run.returncode, run.stdout.strip()) == (2, "")


@pytest.mark.slow
@needs_full
@pytest.mark.parametrize("words", ["--version", "design --friction 0.5", "design --help"])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_output_is_an_error_in_one_line(tmp_path: Path, words: str, unbuffered: str) -> None:
    run = shell(f"{words} > /dev/full", tmp_path, PYTHONUNBUFFERED=unbuffered)
    assert run.returncode == 2
    assert run.stderr == ("grasp3d: standard output: cannot be written (No space left on device)\n")
