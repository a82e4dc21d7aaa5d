"""The Dask cluster that does the work: one of this process, or one that runs already."""

import asyncio
import json
import logging
import threading
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import dask
from distributed import Client, LocalCluster, Security, rpc
from distributed.system import MEMORY_LIMIT

from grasp3d.batch.batch_settings import MIN_WORKER_MEMORY, ClusterSettings
from grasp3d.batch.crew import SAME, Crew, unable
from grasp3d.batch.working import KEPT, versions
from grasp3d.errors import SettingError
from grasp3d.isolation import end_idle
from grasp3d.system.processors import available_processors

CONNECTING = 8.0
"""Time to find a running cluster, and then to be answered by it [s]."""

_STARTING = threading.Lock()
"""Two clusters that start at once in one process would import the same modules half."""

_CONFIG = {
    "distributed.comm.timeouts.connect": f"{CONNECTING}s",
    # What takes memory is in the children, which are watched one by one.
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.profile.enabled": False,
}


@contextmanager
def crew(settings: ClusterSettings) -> Iterator[Crew]:
    """Open the cluster for as long as it is needed.

    Raises:
        SettingError: There is no cluster where one is said to run, or it is another version.
    """
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_CONFIG))
        stack.enter_context(_quiet())
        if settings.scheduler is None:
            stack.callback(end_idle)
            client = stack.enter_context(_embedded(settings))
            made = Crew(client, "this machine")
        else:
            client = stack.enter_context(_running(settings.scheduler))
            made = Crew(client, settings.scheduler)
        stack.callback(made.leave)
        yield made


def local_workers(settings: ClusterSettings) -> int:
    """How many jobs to do at once on this machine: as many as have a processor and some memory."""
    if settings.workers is not None:
        return settings.workers
    least = settings.worker_memory or MIN_WORKER_MEMORY
    return max(1, min(available_processors(), int(KEPT * MEMORY_LIMIT / 1e9 / least)))


@contextmanager
def _embedded(settings: ClusterSettings) -> Iterator[Client]:
    """Start a cluster whose workers are threads of this process, each with a child of its own.

    Worker processes and nannies between this process and the children would protect nothing more,
    and a script that starts them needs its main part guarded.
    """
    with _STARTING:
        cluster = LocalCluster(
            n_workers=1,
            threads_per_worker=local_workers(settings),
            processes=False,
            memory_limit=None,
            # Any free port of this machine alone: the usual one may be taken by another run.
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        )
    with cluster, Client(cluster, set_as_default=False) as client:
        yield client


@contextmanager
def _running(scheduler: str) -> Iterator[Client]:
    address = _address(scheduler)
    with ThreadPoolExecutor(1) as thread:  # this one may have an event loop already
        try:
            kind = thread.submit(asyncio.run, _kind(address)).result()
        except (OSError, ValueError, TypeError, ImportError) as error:
            raise SettingError(
                f"{scheduler}: no Dask scheduler answers there ({_line(error)}); "
                "give the address that it printed, such as tcp://HOST:8786, or its scheduler file"
            ) from error
    if kind != "Scheduler":
        raise SettingError(f"{scheduler}: is the address of a Dask {kind}; give the scheduler's")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of other versions, which are told below
        client = Client(address, timeout=CONNECTING, set_as_default=False)
    with client:
        _check_versions(client, scheduler)
        yield client


async def _kind(address: str) -> str:
    """What answers at an address: a client would wait for ever at a port of something else."""
    security = Security().get_connection_args("client")
    async with asyncio.timeout(CONNECTING), rpc(address, connection_args=security) as server:
        return str((await server.identity())["type"])


def _check_versions(client: Client, scheduler: str) -> None:
    try:
        found = client.run_on_scheduler(versions)
    except Exception as error:
        raise SettingError(unable(scheduler, error)) from error
    if found != versions():
        raise SettingError(
            f"{scheduler}: the scheduler runs {found}, this process {versions()}; {SAME}"
        )


def _address(scheduler: str) -> str:
    """Read the address from a scheduler file, which may still be on its way."""
    if not scheduler.endswith(".json"):
        return scheduler if "://" in scheduler else f"tcp://{scheduler}"
    path, end = Path(scheduler), time.monotonic() + CONNECTING
    while True:
        try:
            return str(json.loads(path.read_text(encoding="utf-8"))["address"])
        except (OSError, ValueError, LookupError, TypeError) as error:
            if time.monotonic() > end:
                raise SettingError(
                    f"{scheduler}: is no scheduler file ({_line(error)}); start the scheduler "
                    f"with: dask scheduler --scheduler-file {scheduler}"
                ) from error
            time.sleep(0.1)


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or f"nothing for {CONNECTING:g} s"


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log to itself: what it would say, at length, is said in rows and errors."""
    known = logging.root.manager.loggerDict
    names = ["distributed", *(name for name in known if name.startswith("distributed."))]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)
