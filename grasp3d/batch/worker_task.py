"""The task of a Dask worker: run one job in a child process and watch it."""

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from distributed import Status, Worker, get_worker
from distributed.system import MEMORY_LIMIT

from grasp3d.batch.job_requests import (
    USABLE_MEMORY,
    Request,
    Result,
    ResultKind,
    result_of,
    versions,
)
from grasp3d.system.isolation import CallFailedError, call, describe_unexpected, end_idle
from grasp3d.system.isolation.pickling import run_pickled_call

_ENDING = {Status.closing, Status.closed, Status.failed}

_preparing = threading.Lock()
_prepared: set[bytes] = set()


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
            call(run_pickled_call, request.preparation, request.folder, cancelled=cancelled)
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
