"""A real Dask cluster on this machine: a scheduler and workers as separate processes."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

import psutil

import grasp3d

ROOT = Path(grasp3d.__file__).parents[1]
T = TypeVar("T")
PATHS = {"PYTHONPATH": str(ROOT)}


class DaskCluster:
    """A scheduler, and workers started on demand; all processes end with the context."""

    def __init__(self, folder: Path, environment: Mapping[str, str] = PATHS) -> None:
        self.file = folder / "scheduler.json"
        self._folder, self._started = folder, list[subprocess.Popen[bytes]]()
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        self.scheduler = self._start("scheduler", *options, environment=environment)

    def worker(
        self, *options: str, environment: Mapping[str, str] = PATHS
    ) -> "subprocess.Popen[bytes]":
        """Start a worker with a nanny; return the process of the nanny."""
        limits = ("--nworkers", "1", "--nthreads", "1", "--memory-limit", "2GB")
        options = ("--host", "127.0.0.1", "--no-dashboard", *limits, *options)
        return self._start("worker", *options, environment=environment)

    def _start(
        self, kind: str, *options: str, environment: Mapping[str, str]
    ) -> subprocess.Popen[bytes]:
        with (self._folder / f"{kind}-{len(self._started)}.log").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", kind, "--scheduler-file", str(self.file), *options],
                cwd=self._folder,
                stdout=log,
                stderr=log,
                env={**os.environ, **environment},
            )
        self._started.append(process)
        return process

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for process in self._started:
            others = descendants(process.pid)
            process.kill()
            process.wait()
            for other in others:
                other.kill()


def descendants(pid: int) -> list[psutil.Process]:
    """All descendants of a process."""
    try:
        return psutil.Process(pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def runs(process: psutil.Process, word: str) -> bool:
    """Whether the command of a process contains a word."""
    try:
        return any(word in part for part in process.cmdline())
    except psutil.Error:
        return False


def has_ended(pid: int) -> bool:
    """Whether a process has ended."""
    try:
        return bool(psutil.Process(pid).status() == psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return True


def wait_for(found: Callable[[], T], seconds: float = 15.0) -> T:
    """Wait until a function returns a true value, and return it."""
    end = time.monotonic() + seconds
    while not (result := found()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return result
