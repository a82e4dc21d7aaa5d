"""Completion by the shells, in which the printed script runs."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.helpers.commands import printed

CASES = {
    ("grasp3d", "lab"): ["label"],
    ("grasp3d", "label", "--sensor"): ["--sensor-resolution"],
    ("grasp3d", "label", "x.stl", "--unit", "m"): ["m", "mm"],
    ("grasp3d", "sweep", "--mass"): [],
    ("grasp3d", "label", "--repair", "f"): ["full"],
}


def test_bash_completes_commands_options_and_words(tmp_path: Path) -> None:
    (tmp_path / "grasp3d.sh").write_text(printed("--completion", cwd=tmp_path), encoding="utf-8")
    bash = shutil.which("bash")
    assert bash is not None
    for words, expected in CASES.items():
        typed = f"source ./grasp3d.sh; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}"
        command = [bash, "-c", f'{typed}; _grasp3d; echo "${{COMPREPLY[@]}}"']
        done = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
        assert done.stdout.split() == expected


def test_zsh_reads_the_script(tmp_path: Path) -> None:
    zsh = shutil.which("zsh")
    if zsh is None:
        pytest.skip("zsh is not installed")
    (tmp_path / "grasp3d.sh").write_text(printed("--completion", cwd=tmp_path), encoding="utf-8")
    command = [zsh, "-c", "source ./grasp3d.sh && whence -w _grasp3d"]
    done = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
    assert "function" in done.stdout
