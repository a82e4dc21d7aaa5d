"""Requests to a child process, with a thread that enforces the limits meanwhile."""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self, TypeVar

from grasp3d.system.isolation.failures import CallFailedError, CallFailure, failure_from_exit_code
from grasp3d.system.isolation.limits import Limits
from grasp3d.system.isolation.process import ChildProcess

if TYPE_CHECKING:
    from grasp3d.system.isolation.process_tree import ProcessTree

AnswerT = TypeVar("AnswerT")

PERIOD = 0.1
"""Time between two checks of the limits [s]."""


class _LimitMonitor:
    """A thread that ends a process tree when it exceeds a limit."""

    def __init__(self, tree: "ProcessTree", limits: Limits) -> None:
        self.failure: CallFailedError | None = None
        self._tree, self._limits = tree, limits
        self._done = threading.Event()
        self._started = time.monotonic()
        self._thread = threading.Thread(target=self._monitor, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._done.set()
        self._thread.join()

    def _monitor(self) -> None:
        while self.failure is None and not self._done.wait(self._pause()):
            self.failure = self._exceeded()
        if self.failure is not None:
            self._tree.kill()

    def _pause(self) -> float:
        """Return the time until the next check [s]."""
        if self._limits.seconds is None:
            return PERIOD
        return max(0.0, min(PERIOD, self._started + self._limits.seconds - time.monotonic()))

    def _exceeded(self) -> CallFailedError | None:
        """Return the error for a limit that is exceeded; None: none is."""
        memory, seconds = self._limits.memory, self._limits.seconds
        if self._limits.cancelled():
            return CallFailedError(CallFailure.CANCELLED, "was cancelled")
        if seconds is not None and time.monotonic() - self._started >= seconds:
            return CallFailedError(
                CallFailure.OUT_OF_TIME, f"took longer than {seconds:g} s and was ended"
            )
        if memory is not None and self._tree.memory() > memory:
            return CallFailedError(
                CallFailure.OUT_OF_MEMORY,
                f"took more than {round(memory, 2):g} GB of memory and was ended",
            )
        return None


def send_request(
    child: ChildProcess, request: bytes, reader: Callable[[ChildProcess], AnswerT], limits: Limits
) -> AnswerT:
    """Send a request and read the answer; after any error the child process is closed.

    Args:
        child: The child process.
        request: Bytes to send.
        reader: Reads the whole answer.
        limits: Limits of the request.

    Raises:
        CallFailedError: The child exceeded a limit and was ended, or it ended by itself.
    """
    from grasp3d.system.isolation.process_tree import ProcessTree

    tree, monitor = ProcessTree(child.process.pid), None
    child.kill_descendants = tree.kill
    try:
        with _LimitMonitor(tree, limits) as monitor:
            child.send(request)
            answer = reader(child)
    except (OSError, ValueError, EOFError) as error:
        code = child.close()
        raise (monitor and monitor.failure) or failure_from_exit_code(code) from error
    except BaseException:  # Ctrl-C included: half an answer must not be read by the next request
        child.close()
        raise
    child.kill_descendants = None
    return answer
