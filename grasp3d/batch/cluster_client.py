"""The client of a Dask cluster: it sends requests to the workers and collects their results."""

import logging
import queue
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from itertools import count
from uuid import uuid4

from distributed import Client, Future, KilledWorker

from grasp3d.batch.job_requests import Request, Result, ResultKind
from grasp3d.batch.worker_task import run_request, usable_memory
from grasp3d.errors import GraspError, SettingError

logger = logging.getLogger(__name__)

FIRST_REQUESTS = 4
"""Requests sent to a cluster without workers, so that a cluster that scales on demand starts
some."""

REQUESTS_PER_THREAD = 2
"""Requests sent for each thread, so that no thread waits for this process."""

REFRESH = 1.0
"""Time between two counts of the workers [s]."""

NO_WORKER_WARNING = 60.0
"""Time without any worker after which a warning is logged [s]."""

RESULT_TIMEOUT = 8.0
"""Time to fetch a result that is finished [s]."""

SAME_ENVIRONMENT = "start all of them in the same environment"


class ClusterClient:
    """Sends requests to the workers of a cluster and collects the results."""

    def __init__(self, client: Client, address: str) -> None:
        """Use a connected client; `address` names the cluster in messages."""
        self._client, self._address = client, address
        self._name, self._numbers = f"grasp3d-{uuid4().hex}", count()
        self._pending: dict[int, Future[Result]] = {}
        self._done: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._threads, self._counted = 0, float("-inf")
        self._last_seen = time.monotonic()

    @property
    def window(self) -> int:
        """How many requests should be pending at any time."""
        if time.monotonic() - self._counted > REFRESH:
            self._count_threads()
        return REQUESTS_PER_THREAD * self._threads or FIRST_REQUESTS

    def submit(self, request: Request) -> int:
        """Send a request; returns its number."""
        number = next(self._numbers)
        target = (
            {"workers": [self.largest_worker()[0]], "allow_other_workers": True}
            if request.alone
            else {}
        )
        with self._connection_errors():
            future = self._client.submit(
                run_request, request, key=(self._name, number), pure=False, **target
            )
            self._pending[number] = future
            future.add_done_callback(lambda _: self._done.put(number))
        return number

    def wait(self) -> tuple[int, Result] | None:
        """Wait for a result for a limited time; returns its number and value, or none.

        Raises:
            GraspError: The scheduler is gone, or the workers cannot run the requests.
        """
        try:
            number = self._done.get(timeout=REFRESH)
        except queue.Empty:
            self._check_connection()
            return None
        future = self._pending[number]
        try:
            result = self._result(future)
        except TimeoutError:  # lost together with its worker: the request is run once more
            future.add_done_callback(lambda _: self._done.put(number))
            return None
        del self._pending[number]
        future.release()
        return number, result

    def largest_worker(self) -> tuple[str, float]:
        """Address of the worker with the most memory, and the memory that jobs may take [GB]."""
        with self._connection_errors():
            memory: dict[str, float] = {}
            while not memory:
                self._count_threads()
                memory = self._client.run(usable_memory, on_error="ignore")
                time.sleep(0.0 if memory else REFRESH)
        return max(memory.items(), key=lambda item: item[1])

    def cancel_all(self) -> None:
        """Cancel all pending requests."""
        if self._pending and self._client.status == "running":
            with suppress(OSError, CancelledError):
                self._client.cancel(list(self._pending.values()), force=True)
        self._pending.clear()

    def _result(self, future: Future[Result]) -> Result:
        try:
            result: Result = future.result(timeout=RESULT_TIMEOUT)
        except KilledWorker as error:
            return Result(ResultKind.WORKER_DIED, error.allowed_failures + 1)
        except TimeoutError:
            raise
        except (CancelledError, OSError) as error:
            raise self._scheduler_gone() from error
        except Exception as error:
            raise SettingError(cannot_run(self._address, error)) from error
        if result.kind is ResultKind.OTHER_VERSIONS:
            raise SettingError(f"{self._address}: {result.value}; {SAME_ENVIRONMENT}")
        return result

    def _count_threads(self) -> None:
        self._check_connection()
        with self._connection_errors():
            self._threads = sum(self._client.nthreads().values())
        now = time.monotonic()
        self._counted = now
        if self._threads:
            self._last_seen = now
        elif now - self._last_seen > NO_WORKER_WARNING:
            logger.warning(
                "%s: no worker for %.0f s; waiting for one", self._address, NO_WORKER_WARNING
            )
            self._last_seen = now

    def _check_connection(self) -> None:
        if self._client.status != "running":
            raise self._scheduler_gone()

    @contextmanager
    def _connection_errors(self) -> Iterator[None]:
        """Raise connection errors as an error of this package."""
        try:
            yield
        except (OSError, CancelledError) as error:
            raise self._scheduler_gone() from error

    def _scheduler_gone(self) -> GraspError:
        return GraspError(
            f"{self._address}: the Dask scheduler is gone; start it again, then this command"
        )


def cannot_run(address: str, error: Exception) -> str:
    """Message for a cluster that responds but cannot run this package."""
    cause = error.__cause__ or error
    reason = " ".join(f"{type(cause).__name__}: {cause}".split())
    return f"{address}: the cluster cannot run the jobs ({reason}); {SAME_ENVIRONMENT}"
