"""Processes on this machine that make calls, each watched by a thread of this process.

They are spawned, not forked, since the locks of threads and compilers do not survive a fork. Later
calls use them again.
"""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import cloudpickle
import psutil

import grasp3d
from grasp3d.errors import GraspError
from grasp3d.jobs.cluster_settings import ClusterSettings
from grasp3d.system.names import describe_unexpected

ValueT = TypeVar("ValueT")


USABLE_MEMORY = 0.9
"""Fraction of the memory that jobs may use; the rest is for the system and for this program."""

PERIOD = 0.1
"""Time between two checks of the limits [s]."""

_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1"
    for library in ("NUMBA", "OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")
}
"""Environment for one thread per process, since each processor already has a process."""

_START = """
import sys
sys.path.insert(0, sys.argv[1])
import grasp3d
sys.path[:] = sys.path[1:] + [path for path in sys.argv[2:] if path not in sys.path[1:]]
from grasp3d.jobs.child_main import main
main()
"""
"""Start code: imports this process's own copy of the package. Modules in the package's parent
folder or in the working folder must not shadow those of Python."""

_idle: list["_Worker"] = []
_lock = threading.Lock()


class LostError(GraspError):
    """A call ended without a result; the message is a predicate without its subject."""


@dataclass(frozen=True)
class Attempt:
    """A job as it is sent to a child process."""

    work: bytes
    """The pickled call; scheduler and worker need not import what only the child needs."""
    seconds: float | None
    """Time limit [s]; None: no limit."""
    memory: float | None
    """Memory limit [GB]; None: an equal part of the available memory."""

    @classmethod
    def of(
        cls, work: Callable[..., object], job: object, cluster: ClusterSettings, threads: int
    ) -> "Attempt":
        """Prepare a job, whose relative paths start in this process's folder."""
        with contextlib.suppress(OSError):  # the folder has been deleted
            work = partial(_in_folder, str(Path.cwd()), work)
        pickled = cloudpickle.dumps(partial(work, job, threads=threads))
        return cls(pickled, cluster.timeout, cluster.worker_memory)

    def answer(self, share: float, cancelled: Callable[[], bool]) -> bytes | str:
        """Return the pickled `Done`, or the reason why there is none; it never raises.

        Args:
            share: Memory for a job without its own limit [GB].
            cancelled: Function that returns whether the job is no longer needed.
        """
        try:
            memory = self.memory or share
            return call(self.work, memory=memory, seconds=self.seconds, cancelled=cancelled)
        except Exception as error:  # noqa: BLE001, a result that does not pickle is lost as well
            return str(error) if isinstance(error, LostError) else describe_unexpected(error)


def _in_folder(folder: str, work: Callable[..., ValueT], *arguments: Any, **options: Any) -> ValueT:
    """Make a call in a folder, if this machine has it."""
    with contextlib.suppress(OSError):
        os.chdir(folder)
    return work(*arguments, **options)


def call(
    work: bytes, *, memory: float, seconds: float | None, cancelled: Callable[[], bool]
) -> bytes:
    """Make a call in another process, which later calls use again.

    The process has one thread per numerical library, and its standard output is discarded.

    Args:
        work: A pickled function without arguments, whose imports this process does not need.
        memory: Limit on the resident memory of the process [GB].
        seconds: Time limit [s]; None: no limit.
        cancelled: Polled in another thread; it returns whether the result is no longer needed.

    Returns:
        The pickled return value of the function.

    Raises:
        LostError: The process crashed, was killed or exceeded a limit, or the function raised.
    """
    worker = _taken()
    answer = worker.answer(work, _Watch(worker, memory, seconds, cancelled))
    with _lock:
        _idle.append(worker)
    if isinstance(answer, str):
        raise LostError(answer)
    return answer


def end_idle() -> None:
    """End the idle processes."""
    with _lock:
        workers, _idle[:] = [*_idle], []
    for worker in workers:
        worker.close()


def _taken() -> "_Worker":
    """Return an idle process that is still alive, or a new one."""
    while True:
        with _lock:
            worker = _idle.pop() if _idle else None
        if worker is None:
            break
        if worker.process.poll() is None:
            return worker
        worker.close()
    try:
        return _Worker()
    except OSError as error:  # the machine has too many processes: no error of the job
        raise LostError(f"cannot be started ({error.strerror})") from error


class _Worker:
    """A process and its pipes."""

    def __init__(self) -> None:
        package = str(Path(grasp3d.__file__).parents[1])
        paths = [path for path in sys.path if Path(path).is_absolute()]
        self.process = subprocess.Popen(  # noqa: S603, the command contains no user input
            [sys.executable, "-I" if sys.flags.isolated else "-P", "-c", _START, package, *paths],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C must reach this process only
            env={**os.environ, **_ONE_THREAD},
        )

    def answer(self, work: bytes, watch: "_Watch") -> bytes | str:
        """Send a call and read the answer of `child_main`; after any error the process is ended.

        Raises:
            LostError: The process exceeded a limit, or ended by itself.
        """
        requests, answers = self.process.stdin, self.process.stdout
        assert requests is not None
        assert answers is not None
        try:
            with watch:
                pickle.dump(work, requests)
                requests.flush()
                answer: bytes | str = pickle.load(answers)  # noqa: S301, of ours
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            ended = self.close()
            raise LostError(watch.reason or _reason(ended)) from error
        except BaseException:  # also Ctrl-C: half an answer must not be read by the next job
            self.close()
            raise
        if watch.reason:  # a limit may be exceeded while the answer is read
            self.close()
            raise LostError(watch.reason)
        return answer

    def kill(self) -> None:
        """End the process, and the processes that it has started."""
        with contextlib.suppress(OSError, AttributeError):  # Windows has no groups
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()

    def close(self) -> int:
        """End the process, and return its exit code, unchanged if it had already ended."""
        if self.process.returncode is None:  # otherwise the id may now belong to another process
            self.kill()
        for pipe in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError, AttributeError):  # for data that could not be written
                pipe.close()  # type: ignore[union-attr]
        return self.process.wait()


class _Watch:
    """A thread that ends a process when it exceeds a limit."""

    def __init__(
        self, worker: _Worker, memory: float, seconds: float | None, cancelled: Callable[[], bool]
    ) -> None:
        self.reason = ""
        self._worker, self._memory, self._seconds = worker, memory, seconds
        self._cancelled, self._done = cancelled, threading.Event()
        self._process, self._started = psutil.Process(worker.process.pid), time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        while not self.reason and not self._done.wait(PERIOD):
            self.reason = self._exceeded()
        if self.reason:
            self._worker.kill()

    def _exceeded(self) -> str:
        """Return which limit is exceeded; empty if none is."""
        if self._cancelled():
            return "was cancelled"
        if self._seconds is not None and time.monotonic() - self._started >= self._seconds:
            return f"took longer than {self._seconds:g} s and was ended"
        with contextlib.suppress(psutil.Error):  # the process has just ended
            if self._process.memory_info().rss > 1e9 * self._memory:
                return (
                    f"took more than {round(self._memory, 2):g} GB of memory and was ended; fewer "
                    "--workers leave more to each"
                )
        return ""


def _reason(code: int) -> str:
    """Describe why a process ended, from its exit code; negative codes are signals."""
    if code >= 0:
        return f"ended its process without a result (exit code {code})"
    if code == -signal.SIGKILL:
        return "was killed from outside, most likely for lack of memory"
    return f"crashed or was killed ({(signal.strsignal(-code) or f'signal {-code}').lower()})"
