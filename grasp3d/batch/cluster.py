"""A running Dask cluster that runs the jobs."""

import asyncio
import json
import logging
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import dask
from distributed import Client, Security, rpc

from grasp3d.batch.cluster_client import SAME_ENVIRONMENT, ClusterClient, cannot_run
from grasp3d.batch.job_requests import versions
from grasp3d.errors import SettingError

CONNECT_TIMEOUT = 8.0
"""Time to find a running cluster, and then to get a response from it [s]."""

_CONFIG = {"distributed.comm.timeouts.connect": f"{CONNECT_TIMEOUT}s"}


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
        raise SettingError(cannot_run(scheduler, error)) from error
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
