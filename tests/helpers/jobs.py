"""Cheap jobs that behave in all the ways meshes can; their child loads nothing heavy."""

import ctypes
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp3d.isolation import NeedsMemory, allowed_memory


@dataclass(frozen=True)
class Work:
    """A cheap job: how it behaves, and where it writes down when it was at work."""

    name: str
    log: Path | None = None

    @property
    def kind(self) -> str:
        return self.name.split("-")[0]


@dataclass(frozen=True)
class Done:
    name: str
    told: str = ""
    memory: float | None = None


def lost(job: Work, reason: str) -> Done:
    return Done(job.name, reason)


def work(job: Work, pause: float) -> Done:
    """Behave as the job is called, and write down the times of every attempt."""
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
    if kind == "deadly":
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(60.0)
    if kind == "hang":
        time.sleep(60.0)
    if kind == "strange":
        raise ValueError("no one thought\nof this")
    if kind == "eats":
        _ = [np.ones(1_250_000) for _ in range(52)]
        time.sleep(0.3)
    if kind == "insatiable":
        _ = [np.ones(1_250_000) for _ in range(10**6)]
    needed = {"modest": 0.4, "large": 0.7, "monstrous": 1e6}.get(kind, 0.0)
    allowed = allowed_memory()
    if allowed is not None and needed > allowed:
        raise NeedsMemory(needed)


def where(job: Work, pause: float) -> Done:  # noqa: ARG001
    return Done(str(os.getpid()))


def needy(job: Work, pause: float) -> Done:  # noqa: ARG001
    raise NeedsMemory(2.0)
