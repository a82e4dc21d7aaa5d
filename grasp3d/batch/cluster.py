"""A running Dask cluster that runs the jobs: its client, and the task of its workers."""

import asyncio
import json
import logging
import queue
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any
from uuid import uuid4

import dask
from distributed import Client, Future, KilledWorker, Security, Status, Worker, get_worker, rpc
from distributed.system import MEMORY_LIMIT

from grasp3d.batch.job_requests import (
    USABLE_MEMORY,
    Request,
    Result,
    ResultKind,
    result_of,
    versions,
)
from grasp3d.batch.limits import CallFailedError
from grasp3d.batch.worker import call_pickled, end_idle
from grasp3d.errors import GraspError, SettingError
from grasp3d.system.names import describe_unexpected

logger = logging.getLogger(__name__)

CONNECT_TIMEOUT = 8.0
"""Time to find a running cluster, and then to get a response from it [s]."""

_CONFIG = {"distributed.comm.timeouts.connect": f"{CONNECT_TIMEOUT}s"}

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

_ENDING = {Status.closing, Status.closed, Status.failed}

_preparing = threading.Lock()
_prepared: set[bytes] = set()


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
            raise SettingError(_cannot_run(self._address, error)) from error
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


def _cannot_run(address: str, error: Exception) -> str:
    """Message for a cluster that responds but cannot run this package."""
    cause = error.__cause__ or error
    reason = " ".join(f"{type(cause).__name__}: {cause}".split())
    return f"{address}: the cluster cannot run the jobs ({reason}); {SAME_ENVIRONMENT}"


@contextmanager
def open_cluster(scheduler: str) -> Iterator[ClusterClient]:
    """Connect to a running cluster for the duration of the context.

    Args:
        scheduler: Address of its scheduler, or the scheduler's file.

    Raises:
        SettingError: No cluster runs at the given address, or it runs other versions.
    """
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_CONFIG))
        stack.enter_context(_silenced_logs())
        client = ClusterClient(stack.enter_context(_running_cluster(scheduler)), scheduler)
        stack.callback(client.cancel_all)
        yield client


@contextmanager
def _running_cluster(scheduler: str) -> Iterator[Client]:
    address = _address(scheduler)
    with ThreadPoolExecutor(1) as thread:  # the current thread may have an event loop already
        try:
            kind = thread.submit(asyncio.run, _kind(address)).result()
        except (OSError, ValueError, TypeError, ImportError) as error:
            raise SettingError(
                f"{scheduler}: no Dask scheduler responds at this address ({_line(error)}); "
                "give the address that it printed, such as tcp://HOST:8786, or its scheduler file"
            ) from error
    if kind != "Scheduler":
        raise SettingError(
            f"{scheduler}: is the address of a Dask {kind}; give the scheduler's address"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of other versions, which are checked below
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    with client:
        _check_versions(client, scheduler)
        yield client


async def _kind(address: str) -> str:
    """Kind of the Dask server at an address; a client would wait for ever for any other server."""
    security = Security().get_connection_args("client")
    async with asyncio.timeout(CONNECT_TIMEOUT), rpc(address, connection_args=security) as server:
        return str((await server.identity())["type"])


def _check_versions(client: Client, scheduler: str) -> None:
    try:
        theirs = client.run_on_scheduler(versions)
    except Exception as error:
        raise SettingError(_cannot_run(scheduler, error)) from error
    if theirs != versions():
        raise SettingError(
            f"{scheduler}: the scheduler runs {theirs}, this process {versions()}; "
            f"{SAME_ENVIRONMENT}"
        )


def _address(scheduler: str) -> str:
    """Read the address from a scheduler file, which may appear a little later."""
    if not scheduler.endswith(".json"):
        return scheduler if "://" in scheduler else f"tcp://{scheduler}"
    path, end = Path(scheduler), time.monotonic() + CONNECT_TIMEOUT
    while True:
        try:
            return str(json.loads(path.read_text(encoding="utf-8"))["address"])
        except (OSError, ValueError, LookupError, TypeError) as error:
            if time.monotonic() > end:
                raise SettingError(
                    f"{scheduler}: is not a scheduler file ({_line(error)}); start the scheduler "
                    f"with: dask scheduler --scheduler-file {scheduler}"
                ) from error
            time.sleep(0.1)


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or f"no response for {CONNECT_TIMEOUT:g} s"


@contextmanager
def _silenced_logs() -> Iterator[None]:
    """Silence Dask's logs: rows and errors report the same failures in one sentence."""
    loggers = logging.root.manager.loggerDict
    names = ["distributed", *(name for name in loggers if name.startswith("distributed."))]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


def run_request(request: Request) -> Result:
    """Run one job, as a task of a Dask worker; every failure is a result, not an exception."""
    worker = get_worker()
    if request.versions != versions():
        message = (
            f"the worker at {worker.address} runs {versions()}, this process {request.versions}"
        )
        return Result(ResultKind.OTHER_VERSIONS, message)
    memory = request.memory_limit(usable_memory(worker), worker.state.nthreads)
    if request.alone:
        end_idle()  # the memory of idle children is part of what the job may take
    cancelled = _cancelled(worker, worker.get_current_task())
    try:
        prepare(request, cancelled)
    except Exception as error:  # noqa: BLE001, as a failure of the job itself
        return Result(ResultKind.FAILED, describe_unexpected(error))
    return result_of(request, memory, cancelled)


def prepare(request: Request, cancelled: Callable[[], bool]) -> None:
    """Make the call that prepares a worker, if it was not made yet; other jobs wait meanwhile.

    Args:
        request: The next job.
        cancelled: Whether the job is no longer needed; another job then makes the call.
    """
    with _preparing:
        if request.preparation is None or request.preparation in _prepared:
            return
        with suppress(CallFailedError):  # jobs report the same failure
            call_pickled(request.preparation, request.folder, cancelled=cancelled)
            _prepared.add(request.preparation)


def usable_memory(dask_worker: Worker) -> float:
    """Memory of a worker that jobs may take [GB], from its memory limit or its machine's memory."""
    return USABLE_MEMORY * (dask_worker.memory_manager.memory_limit or MEMORY_LIMIT) / 1e9


def _cancelled(worker: Worker, key: Any) -> Callable[[], bool]:
    """Make a function that returns whether a task of the worker was cancelled.

    The scheduler releases tasks when they are cancelled, and when their client is gone.
    """

    def cancelled() -> bool:
        task = worker.state.tasks.get(key)
        return task is None or task.state != "executing" or worker.status in _ENDING

    return cancelled
