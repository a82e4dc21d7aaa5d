"""Standard output that is full."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.helpers.commands import COMMAND


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is missing")
@pytest.mark.parametrize("words", ["--version", "design --help"])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_output_is_an_error_in_one_line(tmp_path: Path, words: str, unbuffered: str) -> None:
    run = subprocess.run(  # noqa: S602
        f"'{COMMAND}' {words} > /dev/full",
        check=False, capture_output=True, text=True, shell=True, cwd=tmp_path,
        env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
    )  # fmt: skip
    assert run.returncode == 2
    assert run.stderr == "grasp3d: standard output: cannot be written (No space left on device)\n"
