"""The command line, run in this process or in its own one, and meshes for it."""

import io
import os
import re
import shlex
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from unittest import mock

import trimesh

from grasp3d.cli import main
from tests.helpers.shapes import Surface

COMMAND = Path(sys.executable).with_name("grasp3d")


def export(path: Path, shape: Surface) -> Path:
    """Write a mesh file, and create its folder if it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Trimesh(*shape, process=False).export(path)
    return path


def run_process(
    *arguments: str | Path, cwd: Path, columns: int = 160, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder, in its own process."""
    return subprocess.run(
        [COMMAND, *map(str, arguments)], cwd=cwd, timeout=300,
        env={**(os.environ if env is None else env), "COLUMNS": str(columns)},
        check=False, capture_output=True, text=True,
    )  # fmt: skip


def run_here(
    *arguments: str | Path, cwd: Path, columns: int = 160
) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder, in this process, as a new one would cost seconds."""
    out, err, words = io.StringIO(), io.StringIO(), list(map(str, arguments))
    environment = mock.patch.dict(os.environ, COLUMNS=str(columns))
    with environment, chdir(cwd), redirect_stdout(out), redirect_stderr(err):
        try:
            code = main(words)
        except SystemExit as ended:  # usage errors
            code = int(ended.code or 0)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def printed(*arguments: str | Path, cwd: Path, columns: int = 160) -> str:
    """Run a command that must succeed without any error, and return what it prints."""
    run = run_here(*arguments, cwd=cwd, columns=columns)
    assert (run.returncode, run.stderr) == (0, "")
    return run.stdout


def refusal(words: str, cwd: Path) -> str:
    """Run a command that must refuse its input and write nothing; return its one-line error."""
    before = contents(cwd)
    run = run_here(*shlex.split(words), cwd=cwd)
    assert (run.returncode, run.stdout) == (2, ""), run.stdout
    assert re.fullmatch(r"grasp3d: [^\n]+\n", run.stderr), run.stderr
    assert contents(cwd) == before
    return run.stderr


def contents(folder: Path) -> dict[Path, bytes]:
    """Return the contents of all files and folders below a folder."""
    return {path: path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}
