import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import pytest

from grasp3d.batch import compiling_first, worker_task
from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.compiling_first import compile_first
from grasp3d.batch.job_requests import Request
from grasp3d.batch.run import run
from grasp3d.batch.warmup import announcement, compile_kernels
from grasp3d.system.isolation import CallFailedError, CallFailure
from tests.helpers.jobs import Work, lost, work


@dataclass
class Calls:
    """Calls in child processes, which are recorded but not made."""

    line: str = ""
    failing: bool = False
    made: list[tuple[Any, ...]] = field(default_factory=list)

    def __call__(self, function: Callable[..., Any], *arguments: Any, **limits: Any) -> str:
        time.sleep(0.01)
        self.made.append((function, *arguments))
        assert not {"memory", "seconds"} & set(limits)
        if self.failing:
            raise CallFailedError(CallFailure.CANCELLED, "was cancelled")
        return self.line if function is announcement else ""


@pytest.fixture(autouse=True)
def _nothing_compiled() -> Iterator[None]:
    compile_first.cache_clear()
    yield
    compile_first.cache_clear()


def test_kernels_are_compiled_once_and_announced_before(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    calls = Calls("compiling takes a while")
    monkeypatch.setattr(compiling_first, "call", calls)
    compile_first(2)
    compile_first(2)
    assert calls.made == [(announcement, 2, False, False), (compile_kernels, 2, False, False)]
    assert [(one.name, one.getMessage()) for one in caplog.records] == [
        ("grasp3d.compiling", "compiling takes a while")
    ]


def test_compiled_kernels_are_not_announced(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    calls = Calls()
    monkeypatch.setattr(compiling_first, "call", calls)
    compile_first(3)
    assert (calls.made, caplog.messages) == ([(announcement, 3, False, False)], [])


def test_a_child_that_cannot_compile_is_left_to_the_jobs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling_first, "call", Calls(failing=True))
    compile_first(2)


@pytest.mark.slow
def test_a_run_compiles_before_its_first_job(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[object] = []

    def noted(*arguments: object, children: int = 1) -> None:
        assert children == 1
        order.append(arguments)

    monkeypatch.setattr("grasp3d.batch.run.compile_first", noted)
    monkeypatch.setattr("grasp3d.batch.run.compile_kernels", noted)
    jobs = [Work("well")]
    for workers in (1, 0):
        cluster = ClusterSettings(workers=workers)
        options: dict[str, Any] = {"started": order.append, "kernels": 4, "forces": True}
        rows = run(work, jobs, 0.0, lost=lost, cluster=cluster, **options)
        assert len(list(rows)) == 1
    assert order == [(4, False, True), jobs[0], (4, False, True), jobs[0]]


def test_each_worker_of_a_cluster_prepares_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several threads of a worker get their first requests at once."""
    calls = Calls()
    monkeypatch.setattr(worker_task, "call", calls)
    monkeypatch.setattr(worker_task, "_prepared", set())
    plain = Request(b"job", "", memory=1.0, seconds=1.0, alone=False, versions="")
    prepared = Request(b"job", "", 1.0, 1.0, alone=False, versions="", preparation=b"compile")
    with ThreadPoolExecutor(4) as threads:
        for request in [prepared, plain] * 4:
            threads.submit(worker_task.prepare, request, bool)
    assert calls.made == [(worker_task.run_pickled_call, b"compile", "")]


def test_a_cancelled_preparation_is_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = Calls(failing=True)
    monkeypatch.setattr(worker_task, "call", calls)
    monkeypatch.setattr(worker_task, "_prepared", set())
    request = Request(b"job", "", 1.0, 1.0, alone=False, versions="", preparation=b"compile")
    worker_task.prepare(request, bool)
    worker_task.prepare(request, bool)
    assert len(calls.made) == 2
