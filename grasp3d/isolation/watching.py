"""One request to a child, with somebody who watches meanwhile what it takes."""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self, TypeVar

from grasp3d.isolation.limits import Limits
from grasp3d.isolation.losses import Loss, Lost, lost_by_exit
from grasp3d.isolation.process import Child

if TYPE_CHECKING:
    from grasp3d.isolation.trees import Tree

AnswerT = TypeVar("AnswerT")

PERIOD = 0.1
"""Time between two looks at a child [s]."""


class _Watch:
    """A thread that ends a child's processes when they break a limit."""

    def __init__(self, tree: "Tree", limits: Limits) -> None:
        self.lost: Lost | None = None
        self._tree, self._limits = tree, limits
        self._done = threading.Event()
        self._begun = time.monotonic()
        self._thread = threading.Thread(target=self._look, daemon=True)

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

    def _look(self) -> None:
        while self.lost is None and not self._done.wait(self._pause()):
            self.lost = self._broken()
        if self.lost is not None:
            self._tree.kill()

    def _pause(self) -> float:
        if self._limits.seconds is None:
            return PERIOD
        return max(0.0, min(PERIOD, self._begun + self._limits.seconds - time.monotonic()))

    def _broken(self) -> Lost | None:
        """Tell which limit is broken."""
        memory, seconds = self._limits.memory, self._limits.seconds
        if self._limits.cancelled():
            return Lost(Loss.CANCELLED, "was taken back")
        if seconds is not None and time.monotonic() - self._begun >= seconds:
            return Lost(Loss.OUT_OF_TIME, f"took longer than {seconds:g} s and was ended")
        if memory is not None and self._tree.memory() > memory:
            return Lost(
                Loss.OUT_OF_MEMORY,
                f"took more than {round(memory, 2):g} GB of memory and was ended",
            )
        return None


def ask(child: Child, request: bytes, read: Callable[[Child], AnswerT], limits: Limits) -> AnswerT:
    """Send a request and read the answer; whatever goes wrong, the child is closed.

    Args:
        child: Who is asked.
        request: Bytes to send.
        read: Reads the whole answer.
        limits: What ends the child.

    Raises:
        Lost: A limit ended the child, or it ended by itself.
    """
    from grasp3d.isolation.trees import Tree

    tree, watch = Tree(child.process.pid), None
    child.kill_below = tree.kill
    try:
        with _Watch(tree, limits) as watch:
            child.send(request)
            answer = read(child)
    except (OSError, ValueError, EOFError) as error:
        code = child.close()
        raise (watch and watch.lost) or lost_by_exit(code) from error
    except BaseException:  # Ctrl-C included: half an answer must not be taken for the next one
        child.close()
        raise
    child.kill_below = None
    return answer
