"""The Dask cluster that runs the jobs: one within this process, or a running one."""

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
from tempfile import TemporaryDirectory

import dask
from distributed import Client, LocalCluster, Security, rpc
from distributed.system import MEMORY_LIMIT

from grasp3d.batch.batch_settings import MIN_WORKER_MEMORY, ClusterSettings
from grasp3d.batch.cluster_client import SAME_ENVIRONMENT, ClusterClient, cannot_run
from grasp3d.batch.worker_task import USABLE_MEMORY, versions
from grasp3d.errors import SettingError
from grasp3d.isolation import end_idle
from grasp3d.system.processors import available_processors

CONNECT_TIMEOUT = 8.0
"""Time to find a running cluster, and then to get a response from it [s]."""

_STARTING = threading.Lock()
"""Held while a cluster starts: two that start at once in one process would each import only part
of the same modules."""

_CONFIG = {
    "distributed.comm.timeouts.connect": f"{CONNECT_TIMEOUT}s",
    # The memory is taken by the child processes, which are watched one by one.
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.profile.enabled": False,
}


@contextmanager
def open_cluster(settings: ClusterSettings) -> Iterator[ClusterClient]:
    """Start a cluster, or connect to a running one, for the duration of the context.

    Raises:
        SettingError: No cluster runs at the given address, or it runs other versions.
    """
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_CONFIG))
        stack.enter_context(_silenced_logs())
        if settings.scheduler is None:
            stack.callback(end_idle)
            client = stack.enter_context(_local_cluster(settings))
            cluster_client = ClusterClient(client, "this machine")
        else:
            client = stack.enter_context(_running_cluster(settings.scheduler))
            cluster_client = ClusterClient(client, settings.scheduler)
        stack.callback(cluster_client.cancel_all)
        yield cluster_client


def local_workers(settings: ClusterSettings) -> int:
    """Jobs to run at once on this machine, limited by its processors and its memory."""
    if settings.workers is not None:
        return settings.workers
    least = settings.worker_memory or MIN_WORKER_MEMORY
    return max(1, min(available_processors(), int(USABLE_MEMORY * MEMORY_LIMIT / 1e9 / least)))


@contextmanager
def _local_cluster(settings: ClusterSettings) -> Iterator[Client]:
    """Start a cluster whose workers are threads of this process, each with a child process.

    Worker processes and nannies between this process and the children would protect nothing more,
    and a script that starts them would need `if __name__ == "__main__"`.
    """
    with (
        TemporaryDirectory(prefix="grasp3d-dask-", ignore_cleanup_errors=True) as folder,
        dask.config.set({"temporary-directory": folder}),  # where Dask leaves lock files
    ):
        with _STARTING:
            cluster = LocalCluster(
                n_workers=1,
                threads_per_worker=local_workers(settings),
                processes=False,
                memory_limit=None,
                # Any free port, on this machine only: another run may have taken the default port.
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
        with cluster, Client(cluster, set_as_default=False) as client:
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
        found = client.run_on_scheduler(versions)
    except Exception as error:
        raise SettingError(cannot_run(scheduler, error)) from error
    if found != versions():
        raise SettingError(
            f"{scheduler}: the scheduler runs {found}, this process {versions()}; "
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
