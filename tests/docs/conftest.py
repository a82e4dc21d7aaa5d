"""The documentation site, built once for all tests."""

import fcntl
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The folder of the built site; what the build printed is beside it, in `site.log`."""
    base = tmp_path_factory.getbasetemp()
    folder = (base if worker_id == "master" else base.parent) / "site"
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # one worker builds, the others wait
        if not folder.is_dir():
            options = ["--keep-going", "--quiet", "--no-color"]
            command = [sys.executable, "-m", "sphinx", "-W", *options, DOCS, folder]
            with folder.with_suffix(".log").open("w") as log:
                done = subprocess.run(command, check=False, stdout=log, stderr=log)
                log.write(f"exit code {done.returncode}")
    return folder
