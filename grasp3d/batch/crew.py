"""The workers of a Dask cluster: what they are asked to do, and what they answer."""

import logging
import queue
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from itertools import count
from uuid import uuid4

from distributed import Client, Future, KilledWorker

from grasp3d.batch.working import Answer, Ending, Order, perform, whole_memory
from grasp3d.errors import GraspError, SettingError

logger = logging.getLogger(__name__)

FIRST = 4
"""Jobs that are sent to a cluster without workers, so that one that grows on demand begins to."""

AHEAD = 2
"""Jobs that are sent for each thread, so that none waits for this process."""

REFRESH = 1.0
"""How often the workers are counted [s]."""

SILENCE = 60.0
"""Time without any worker after which it is told [s]."""

LOOKING = 8.0
"""Time for a result that is known to be there [s]."""

SAME = "start all of them in the same environment"


class Crew:
    """The workers, and what they were asked to do."""

    def __init__(self, client: Client, place: str) -> None:
        self._client, self._place = client, place
        self._name, self._numbers = f"grasp3d-{uuid4().hex}", count()
        self._flying: dict[int, Future[Answer]] = {}
        self._done: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._threads, self._counted = 0, float("-inf")
        self._seen = time.monotonic()

    @property
    def window(self) -> int:
        """How many orders to have sent at any time."""
        if time.monotonic() - self._counted > REFRESH:
            self._count()
        return AHEAD * self._threads or FIRST

    def submit(self, order: Order) -> int:
        """Send an order; returns its number."""
        number = next(self._numbers)
        where = {"workers": [self.largest()[0]], "allow_other_workers": True} if order.alone else {}
        with self._told():
            future = self._client.submit(
                perform, order, key=(self._name, number), pure=False, **where
            )
            self._flying[number] = future
            future.add_done_callback(lambda _: self._done.put(number))
        return number

    def wait(self) -> tuple[int, Answer] | None:
        """Give the number and the answer of an order that is done, or none after a while.

        Raises:
            GraspError: The scheduler is gone, or the workers cannot do this work.
        """
        try:
            number = self._done.get(timeout=REFRESH)
        except queue.Empty:
            self._check()
            return None
        future = self._flying[number]
        try:
            answer = self._answer(future)
        except TimeoutError:  # its worker was lost with it: it is done once more
            future.add_done_callback(lambda _: self._done.put(number))
            return None
        del self._flying[number]
        future.release()
        return number, answer

    def largest(self) -> tuple[str, float]:
        """Address of the worker with the most memory, and what work may take of it [GB]."""
        with self._told():
            found: dict[str, float] = {}
            while not found:
                self._count()
                found = self._client.run(whole_memory, on_error="ignore")
                time.sleep(0.0 if found else REFRESH)
        return max(found.items(), key=lambda item: item[1])

    def leave(self) -> None:
        """Take back all orders that are not done."""
        if self._flying and self._client.status == "running":
            with suppress(OSError, CancelledError):
                self._client.cancel(list(self._flying.values()), force=True)
        self._flying.clear()

    def _answer(self, future: Future[Answer]) -> Answer:
        try:
            answer: Answer = future.result(timeout=LOOKING)
        except KilledWorker as error:
            return Answer(Ending.DIED, error.allowed_failures + 1)
        except TimeoutError:
            raise
        except (CancelledError, OSError) as error:
            raise self._gone() from error
        except Exception as error:
            raise SettingError(unable(self._place, error)) from error
        if answer.ending is Ending.OTHER:
            raise SettingError(f"{self._place}: {answer.value}; {SAME}")
        return answer

    def _count(self) -> None:
        self._check()
        with self._told():
            self._threads = sum(self._client.nthreads().values())
        now = time.monotonic()
        self._counted = now
        if self._threads:
            self._seen = now
        elif now - self._seen > SILENCE:
            logger.warning("%s: no worker for %.0f s; waiting for one", self._place, SILENCE)
            self._seen = now

    def _check(self) -> None:
        if self._client.status != "running":
            raise self._gone()

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Tell in a sentence that the scheduler is gone."""
        try:
            yield
        except (OSError, CancelledError) as error:
            raise self._gone() from error

    def _gone(self) -> GraspError:
        return GraspError(
            f"{self._place}: the Dask scheduler is gone; start it again, then this command"
        )


def unable(place: str, error: Exception) -> str:
    """Say in a sentence that a cluster answers, but cannot run this package."""
    cause = error.__cause__ or error
    told = " ".join(f"{type(cause).__name__}: {cause}".split())
    return f"{place}: the cluster cannot do this work ({told}); {SAME}"
