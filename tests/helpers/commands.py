"""The command line in this process, for what does not need one of its own."""

import io
import os
import subprocess
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from unittest import mock

from grasp3d.cli import main


def run_here(
    *arguments: str | Path, cwd: Path, columns: int = 160
) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder; a new process for each would cost seconds."""
    out, err, words = io.StringIO(), io.StringIO(), list(map(str, arguments))
    environment = mock.patch.dict(os.environ, COLUMNS=str(columns))
    with environment, chdir(cwd), redirect_stdout(out), redirect_stderr(err):
        try:
            code = main(words)
        except SystemExit as ended:  # errors of usage
            code = int(ended.code or 0)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())
