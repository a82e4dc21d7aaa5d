"""Processes of this machine that run jobs, each watched by a thread of this process.

They are spawned, not forked, since locks of threads and compilers do not survive a fork, and are
used again for later jobs.
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
from pathlib import Path
from typing import cast

import cloudpickle
import psutil

import grasp3d
from grasp3d.batch.limits import CallFailedError, CallFailure, failure_from_exit_code
from grasp3d.batch.worker_main import NO_MEMORY, RAISED

PERIOD = 0.1
"""Time between two checks of the limits [s]."""

_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1"
    for library in ("NUMBA", "OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")
}
"""Environment for one thread per process, since each processor has a process already."""

_START = """
import sys
package, *paths = sys.argv[1:]
sys.path.insert(0, package)
import grasp3d
sys.path[:] = sys.path[1:] + [path for path in paths if path not in sys.path[1:]]
from grasp3d.batch.worker_main import main
main()
"""
"""Start code: imports this process's own copy of the package. Modules in the package's parent
folder or in the working folder must not shadow those of Python."""

_idle: list["_Worker"] = []
_lock = threading.Lock()


def _never() -> bool:
    """Return False: the job is never cancelled."""
    return False


def pickle_call(function: Callable[..., object], *arguments: object) -> bytes:
    """Pickle a function call; functions and classes of a script are pickled by value."""
    data: bytes = cloudpickle.dumps((function, arguments))
    return data


def call_pickled(
    work: bytes,
    folder: str = "",
    *,
    memory: float | None = None,
    seconds: float | None = None,
    cancelled: Callable[[], bool] = _never,
) -> bytes:
    """Make a call in another process, which is used again for later calls.

    It has the module search path of this process, and one thread per numerical library. Its
    standard output is discarded.

    Args:
        work: The call, from `pickle_call`: this process need not import what it needs.
        folder: Working folder, if it exists, so that relative paths mean the same as where the
            call was pickled; else that of this process.
        memory: Limit for the resident memory of the process [GB]; none: no limit.
        seconds: Time limit [s]; none: no limit.
        cancelled: Polled in another thread: whether the result is no longer needed.

    Returns:
        The pickled return value of the function.

    Raises:
        CallFailedError: The process crashed, was killed or exceeded a limit.
        Exception: The exception that the function raised, with its traceback as a note.
    """
    here = working_folder()
    paths = [str(Path(here, path)) for path in sys.path]
    existing = folder if folder and Path(folder).is_dir() else here
    worker = _taken()
    code, data = worker.answer((existing, paths, memory, work), memory, seconds, cancelled)
    with _lock:
        _idle.append(worker)
    if code == RAISED:
        raise pickle.loads(data)  # noqa: S301, from a process of ours
    return data


def end_idle() -> None:
    """End the idle processes."""
    with _lock:
        workers, _idle[:] = [*_idle], []
    for worker in workers:
        worker.close()


def working_folder() -> str:
    """Return the working folder of this process; the root if the folder was deleted."""
    try:
        return str(Path.cwd())
    except OSError:
        return os.sep


def _taken() -> "_Worker":
    """An idle process that is still alive, or a new one."""
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
    except OSError as error:  # the machine has too many processes: not an error of the job
        raise CallFailedError(
            CallFailure.KILLED, f"cannot be started ({error.strerror})"
        ) from error


class _Worker:
    """A process, and the pipes to it."""

    def __init__(self) -> None:
        package = str(Path(grasp3d.__file__).parents[1])
        flags = ["-I"] if sys.flags.isolated else ["-P"]
        self.process = subprocess.Popen(  # noqa: S603, the command contains no user input
            [sys.executable, *flags, "-c", _START, package, *_paths()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C must reach this process only
            cwd=package,
            env={**os.environ, **_ONE_THREAD},
        )

    def answer(
        self,
        request: tuple[object, ...],
        memory: float | None,
        seconds: float | None,
        cancelled: Callable[[], bool],
    ) -> tuple[int, bytes]:
        """Send a request and read the answer; after any error the process is ended.

        Raises:
            CallFailedError: The process exceeded a limit, or ended by itself.
        """
        requests, answers = self.process.stdin, self.process.stdout
        assert requests is not None
        assert answers is not None
        watch = _Watch(self, memory, seconds, cancelled)
        try:
            with watch:
                pickle.dump(request, requests)
                requests.flush()
                code, data = cast("tuple[int, bytes]", pickle.load(answers))  # noqa: S301, of ours
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            code = self.close()
            raise watch.failure or failure_from_exit_code(code) from error
        except BaseException:  # Ctrl-C included: half an answer must not be read by the next job
            self.close()
            raise
        if code == NO_MEMORY:
            watch.failure = CallFailedError(
                CallFailure.OUT_OF_MEMORY, "requested more memory than is available and was ended"
            )
        if watch.failure is not None:  # a limit may be exceeded while the answer comes
            self.close()
            raise watch.failure
        return code, data

    def kill(self) -> None:
        """End the process, and those that it started."""
        with contextlib.suppress(OSError, AttributeError):  # Windows has no groups
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()

    def close(self) -> int:
        """End the process, and return its exit code; unchanged if it had ended before."""
        if self.process.returncode is None:  # else the id may belong to another process by now
            self.kill()
        for pipe in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError, AttributeError):  # what could not be written
                pipe.close()  # type: ignore[union-attr]
        return self.process.wait()


class _Watch:
    """A thread that ends a process when it exceeds a limit."""

    def __init__(
        self,
        worker: _Worker,
        memory: float | None,
        seconds: float | None,
        cancelled: Callable[[], bool],
    ) -> None:
        self.failure: CallFailedError | None = None
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
        while self.failure is None and not self._done.wait(PERIOD):
            self.failure = self._exceeded()
        if self.failure is not None:
            self._worker.kill()

    def _exceeded(self) -> CallFailedError | None:
        """The error for a limit that is exceeded; None: none is."""
        if self._cancelled():
            return CallFailedError(CallFailure.CANCELLED, "was cancelled")
        if self._seconds is not None and time.monotonic() - self._started >= self._seconds:
            return CallFailedError(
                CallFailure.OUT_OF_TIME, f"took longer than {self._seconds:g} s and was ended"
            )
        with contextlib.suppress(psutil.Error):  # it has just ended
            if self._memory is not None and self._process.memory_info().rss > 1e9 * self._memory:
                return CallFailedError(
                    CallFailure.OUT_OF_MEMORY,
                    f"took more than {round(self._memory, 2):g} GB of memory and was ended",
                )
        return None


def _paths() -> list[str]:
    """Return the module search path of this process without its working folder."""
    with contextlib.suppress(OSError):
        folder = os.getcwd()  # noqa: PTH109, compared as text
        return [path for path in sys.path if Path(path).is_absolute() and path != folder]
    return []
