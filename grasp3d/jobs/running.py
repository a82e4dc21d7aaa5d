"""Execution of jobs, each in a watched child process, so that a failing job affects no other."""

import contextlib
import pickle
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar, cast

import psutil

from grasp3d._kernels.ahead import warmup
from grasp3d.errors import GraspError
from grasp3d.jobs.child import USABLE_MEMORY, Attempt, LostError, end_idle
from grasp3d.jobs.cluster_settings import MIN_WORKER_MEMORY, ClusterSettings
from grasp3d.system.context import available_processors, is_strict, running
from grasp3d.system.names import describe_unexpected

JobT = TypeVar("JobT")
ValueT = TypeVar("ValueT")

_LIMITS = ("memory.max", "memory.high", "memory/memory.limit_in_bytes")
"""Files with the limits of a control group, of version 2 and of version 1."""

_CONTROL_GROUPS = Path("/sys/fs/cgroup")

SIGNALS = 1.0
"""Longest time until a signal is noticed [s]."""


@dataclass(frozen=True)
class Done(Generic[JobT, ValueT]):
    """A finished job, with its value or its error."""

    job: JobT
    value: ValueT | None = None
    """Return value of the task."""
    error: GraspError | None = None
    """Error of the task, or a `LostError` of its process; None: the task returned."""

    @property
    def result(self) -> ValueT:
        """The value; raises the error, if there is one."""
        if self.error is not None:
            raise self.error
        return cast("ValueT", self.value)


def run(
    task: Callable[[JobT], ValueT],
    jobs: Sequence[JobT],
    *,
    cluster: ClusterSettings,
    compiled: bool = False,
) -> Generator[Done[JobT, ValueT]]:
    """Call a task for every job, and yield each job when it is finished.

    Args:
        task: Function that is called with a job; it may raise a `GraspError`.
        jobs: The jobs, started in order. The last ones get the threads of processes without a job.
        cluster: The processes that run the jobs, and the limits of a job.
        compiled: Whether to compile the kernels before the jobs, outside their limits and times.

    Raises:
        SettingError: No cluster runs at the given address, or its workers cannot run the jobs.
        GraspError: The cluster's scheduler has ended.
    """
    if not jobs:
        return
    if compiled and cluster.scheduler is None:
        warmup()
    work = partial(_done, task, strict=is_strict())
    if cluster.workers == 0:  # a crash of a job ends this process
        yield from map(work, jobs)
        return
    if cluster.scheduler is None:
        finished = _here(work, jobs, cluster)
    else:
        from grasp3d.jobs.cluster import on_cluster  # jobs on this machine need no Dask

        finished = on_cluster(cluster.scheduler, work, jobs, cluster)
    with contextlib.closing(finished):
        for job, answer in finished:
            if isinstance(answer, str):
                yield Done(job, error=LostError(answer))
            else:
                yield pickle.loads(answer)  # noqa: S301, from a child process of ours


def _done(
    task: Callable[[JobT], ValueT], job: JobT, *, strict: bool, threads: int | None = None
) -> Done[JobT, ValueT]:
    """Call a task; its warnings are errors if `strict` is set."""
    try:
        with running(strict=strict, threads=threads):
            return Done(job, task(job))
    except GraspError as error:
        error.__cause__ = error.__context__ = None  # errors of other libraries may not pickle
        return Done(job, error=error)
    except MemoryError:
        return Done(job, error=LostError("requested more memory than is available"))
    except Exception as error:  # noqa: BLE001, a bug met by one mesh must not end the others
        return Done(job, error=LostError(describe_unexpected(error)))


def _here(
    work: Callable[..., object], jobs: Sequence[JobT], cluster: ClusterSettings
) -> Generator[tuple[JobT, bytes | str]]:
    """Run jobs on this machine, with a thread for each child process that watches it."""
    processes = local_workers(cluster)
    share, closed = USABLE_MEMORY * machine_memory() / processes, threading.Event()
    pending: dict[Future[bytes | str], JobT] = {}
    numbers = iter(range(len(jobs)))
    pool = ThreadPoolExecutor(processes, "grasp3d-batch")

    def begin() -> None:
        for number in numbers:
            threads = max(1, processes // (len(pending) + len(jobs) - number))
            attempt = Attempt.of(work, jobs[number], cluster, threads)
            pending[pool.submit(attempt.answer, share, closed.is_set)] = jobs[number]
            if len(pending) >= processes:
                return

    try:
        begin()
        while pending:
            # With a time limit, as Ctrl-C does not end the wait if another thread gets the signal.
            done = wait(pending, SIGNALS, FIRST_COMPLETED).done
            finished = [(pending.pop(one), one.result()) for one in done]
            begin()  # before the results are processed, so that no process waits for that
            yield from finished
    finally:
        closed.set()
        pool.shutdown(cancel_futures=True)
        end_idle()


def local_workers(cluster: ClusterSettings) -> int:
    """Number of jobs to run at once on this machine, limited by its processors and memory."""
    if cluster.workers is not None:
        return cluster.workers
    least = cluster.worker_memory or MIN_WORKER_MEMORY
    return max(1, min(available_processors(), int(USABLE_MEMORY * machine_memory() / least)))


def machine_memory() -> float:
    """Memory of the machine, or the limit of a container, if that is lower [GB]."""
    limits = [float(psutil.virtual_memory().total)]
    for name in _LIMITS:
        with contextlib.suppress(OSError, ValueError):  # none, or the word max
            limits.append(float((_CONTROL_GROUPS / name).read_text(encoding="ascii")))
    return min(limit for limit in limits if limit > 0.0) / 1e9
