"""Running jobs on a Dask cluster: each in a child process of a Dask worker."""

import asyncio
import json
import logging
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar
from uuid import uuid4

import dask
from distributed import Client, Future, KilledWorker, Security, get_worker, rpc, wait
from distributed.system import MEMORY_LIMIT

from grasp3d.errors import GraspError, SettingError
from grasp3d.jobs.child import USABLE_MEMORY, Attempt
from grasp3d.jobs.cluster_settings import ClusterSettings

JobT = TypeVar("JobT")

logger = logging.getLogger(__name__)

CONNECT_TIMEOUT = 8.0
"""Longest time to find a running cluster, and then to get a response from it [s]."""

FIRST_JOBS = 4
"""Jobs sent to a cluster without workers, so that a cluster that scales on demand starts some."""

JOBS_PER_THREAD = 2
"""Jobs sent per thread, so that no thread waits for this process."""

REFRESH = 1.0
"""Time between two counts of the workers [s]."""

NO_WORKER_WARNING = 60.0
"""Time without any worker after which a warning is logged [s]."""

SAME_ENVIRONMENT = "start all of them in the same environment"


def on_cluster(
    scheduler: str, work: Callable[..., object], jobs: Sequence[JobT], cluster: ClusterSettings
) -> Generator[tuple[JobT, bytes | str]]:
    """Run jobs on a running cluster.

    Args:
        scheduler: Address of the scheduler, or the scheduler's file.
        work: Function that is called with a job.
        jobs: The jobs.
        cluster: Limits of a job.

    Yields:
        Each job with its pickled row, or the reason why there is none.

    Raises:
        SettingError: No cluster runs at the address, or its workers cannot run the jobs.
        GraspError: The scheduler has ended.
    """
    with _connected(scheduler) as client:
        name, numbers, counted_at = uuid4().hex, iter(range(len(jobs))), -REFRESH
        pending: dict[Future[bytes | str], JobT] = {}
        window, seen = 0, time.monotonic()
        while True:
            now = time.monotonic()
            if now - counted_at > REFRESH:
                threads = sum(client.nthreads().values())
                window, counted_at = JOBS_PER_THREAD * threads or FIRST_JOBS, now
                if threads:
                    seen = now
                elif now - seen > NO_WORKER_WARNING:
                    logger.warning(
                        "%s: no worker for %.0f s; waiting for one", scheduler, now - seen
                    )
                    seen = now
            while len(pending) < window and (number := next(numbers, None)) is not None:
                attempt = Attempt.of(work, jobs[number], cluster, 1)
                key = (f"grasp3d-{name}", number)
                pending[
                    client.submit(_answer, attempt, version("grasp3d"), key=key, pure=False)
                ] = jobs[number]
            if not pending:
                return
            for future, answer in _finished(client, pending, scheduler):
                yield pending.pop(future), answer
                future.release()


def _finished(
    client: Client, pending: Iterable[Future[bytes | str]], scheduler: str
) -> Iterator[tuple[Future[bytes | str], bytes | str]]:
    """Yield finished jobs with their answers; nothing if no job finishes for some time."""
    try:
        with client.as_current():
            finished = wait([*pending], REFRESH, return_when="FIRST_COMPLETED").done
    except TimeoutError:
        if client.status != "running":
            raise _gone(scheduler) from None
        return
    for future in finished:
        with suppress(TimeoutError):  # lost together with its worker: it will run again
            yield future, _result(future, scheduler)


def _result(future: Future[bytes | str], scheduler: str) -> bytes | str:
    """Return the answer of a finished job.

    Raises:
        SettingError: The worker cannot run the jobs.
    """
    try:
        answer: bytes | str = future.result(timeout=CONNECT_TIMEOUT)
    except KilledWorker as error:
        return f"was lost with its Dask worker {error.allowed_failures + 1} times"
    except (CancelledError, OSError):
        raise
    except Exception as error:
        raise SettingError(_cannot_run(scheduler, error)) from error
    return answer


def _answer(attempt: Attempt, sender: str) -> bytes | str:
    """Run one job, as a task of a Dask worker.

    Raises:
        SettingError: The worker has another version of the package than the sender.
    """
    worker = get_worker()
    own, task = version("grasp3d"), worker.state.tasks.get(worker.get_current_task())
    if own != sender:
        raise SettingError(f"the worker at {worker.address} has grasp3d {own}, this one {sender}")
    usable = USABLE_MEMORY * (worker.memory_manager.memory_limit or MEMORY_LIMIT) / 1e9

    def cancelled() -> bool:  # the scheduler releases tasks whose client has ended
        return task is None or task.state != "executing" or worker.status.name != "running"

    return attempt.answer(usable / worker.state.nthreads, cancelled)


@contextmanager
def _connected(scheduler: str) -> Iterator[Client]:
    """Connect to a running cluster within the context."""
    with ExitStack() as stack:
        config = {"distributed.comm.timeouts.connect": f"{CONNECT_TIMEOUT}s"}
        stack.enter_context(dask.config.set(config))
        stack.enter_context(_silenced_logs())
        address = _address(scheduler)
        thread = stack.enter_context(ThreadPoolExecutor(1))  # this thread may have an event loop
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
            warnings.simplefilter("ignore")  # on other versions; a job reports those that matter
            client = stack.enter_context(
                Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
            )
        try:
            yield client
        except (OSError, CancelledError) as error:
            raise _gone(scheduler) from error


async def _kind(address: str) -> str:
    """Return the kind of the Dask server at an address; clients of other kinds wait for ever."""
    security = Security().get_connection_args("client")
    async with asyncio.timeout(CONNECT_TIMEOUT), rpc(address, connection_args=security) as server:
        return str((await server.identity())["type"])


def _gone(scheduler: str) -> GraspError:
    return GraspError(f"{scheduler}: the Dask scheduler is gone; start it again, then this command")


def _cannot_run(scheduler: str, error: Exception) -> str:
    """Return a message for a cluster that responds but cannot run this package."""
    cause = error.__cause__ or error
    reason = " ".join(f"{type(cause).__name__}: {cause}".split())
    return f"{scheduler}: the cluster cannot run the jobs ({reason}); {SAME_ENVIRONMENT}"


def _address(scheduler: str) -> str:
    """Read the address from a scheduler file, which may not exist yet."""
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
    """Silence Dask's logs, since rows and errors report the same failures in one sentence."""
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
