"""Cheap jobs that fail in all the ways in which meshes can; the child imports nothing heavy."""

import ctypes
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp3d.batch.limits import NeedsMemory, allowed_memory

TIMINGS = frozenset({"seconds", "seconds_reading", "seconds_labelling", "seconds_writing"})
"""Columns of a summary that differ between runs."""


@dataclass(frozen=True)
class Work:
    """A cheap job whose name says how it behaves; it records its times in a folder."""

    name: str
    log: Path | None = None

    @property
    def kind(self) -> str:
        return self.name.split("-")[0]


@dataclass(frozen=True)
class Done:
    name: str
    reason: str = ""
    memory: float | None = None


def lost(job: Work, reason: str) -> Done:
    return Done(job.name, reason)


def work(job: Work, pause: float) -> Done:
    """Behave according to the job's name, and record the times of every attempt."""
    begun = time.monotonic()
    first = True
    if job.log is not None:
        mark = job.log / f"{job.name}.begun"
        first = not mark.exists()
        mark.write_text(f"{begun}", encoding="ascii")
    misbehave(job.kind, first=first)
    time.sleep(pause)
    if job.log is not None:
        (job.log / job.name).write_text(f"{begun} {time.monotonic()}", encoding="ascii")
    return Done(job.name, memory=allowed_memory())


def misbehave(kind: str, *, first: bool) -> None:
    if kind == "crash" or (kind == "crash once" and first):
        ctypes.string_at(0)
    if kind == "killed" or (kind == "killed once" and first):
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "kills its worker":
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(60.0)
    if kind == "hang":
        time.sleep(60.0)
    if kind == "raises":
        raise ValueError("an error of\ntwo lines")
    if kind == "exceeds its limit":
        _ = [np.ones(1_250_000) for _ in range(52)]
        time.sleep(0.3)
    needed = {"0.4 GB": 0.4, "0.7 GB": 0.7, "1e6 GB": 1e6}.get(kind, 0.0)
    allowed = allowed_memory()
    if allowed is not None and needed > allowed:
        raise NeedsMemory(needed)


def process_id(job: Work, pause: float) -> Done:  # noqa: ARG001
    return Done(str(os.getpid()))


def needs_2_gb(job: Work, pause: float) -> Done:  # noqa: ARG001
    raise NeedsMemory(2.0)
