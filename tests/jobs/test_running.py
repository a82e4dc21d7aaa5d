"""Jobs in processes of this machine: results, failures, limits, and the end of all processes."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

import grasp3d
from grasp3d.errors import GraspError
from grasp3d.jobs import ClusterSettings, running
from grasp3d.jobs.running import USABLE_MEMORY, local_workers, machine_memory, run
from tests.helpers.dask_cluster import DaskCluster, has_ended, runs, wait_for
from tests.helpers.jobs import FAULTS, work

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


@pytest.fixture(params=["here", "dask"])
def cluster(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[ClusterSettings]:
    """Two processes, on this machine or of Dask."""
    limits: dict[str, Any] = {"worker_memory": 0.5, "timeout": 6.0}
    if request.param == "here":
        yield ClusterSettings(workers=2, **limits)
        return
    with DaskCluster(tmp_path) as running_one:
        for _ in range(2):
            running_one.worker()
        yield ClusterSettings(scheduler=str(running_one.file), **limits)


@pytest.mark.slow
def test_failing_jobs_say_why_and_affect_no_others(
    cluster: ClusterSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = ((fault, f"well-{number}") for number, fault in enumerate(FAULTS))
    jobs = [job for pair in pairs for job in pair]
    done = {one.job: one for one in run(work, jobs, cluster=cluster)}
    assert {*done} == {*jobs}
    errors = {name: str(done[name].error) for name in FAULTS}
    assert errors == {name: text for name, (_, text) in FAULTS.items()}
    assert all(done[name].error is None for name in jobs if name not in FAULTS)
    with pytest.raises(GraspError, match="no such thing"):
        _ = done["refuses"].result
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")  # where relative paths begin
    (well,) = run(work, ["well"], cluster=cluster)
    pid, session, folder, _ = well.result
    assert folder == str(tmp_path / "other")
    assert os.getpid() not in {pid, session}
    assert session != os.getsid(0)  # Ctrl-C reaches this process only


def test_without_child_processes_jobs_run_in_this_process() -> None:
    here = ClusterSettings(workers=0)
    jobs = ["well", "raises", "refuses", "well-2"]
    done = list(run(work, jobs, cluster=here))
    assert [one.job for one in done] == jobs
    assert [str(one.error) for one in done if one.error] == [FAULTS[job][1] for job in jobs[1:3]]
    assert done[0].result[0] == os.getpid()


@pytest.mark.slow
def test_all_processes_work_and_the_last_jobs_use_all_threads() -> None:
    jobs = [f"well-{number}" for number in range(60)]
    done = list(run(partial(work, pause=0.3), jobs, cluster=ClusterSettings(workers=8)))
    assert len({one.result[0] for one in done}) == 8
    threads = {one.job: one.result[3] for one in done}
    assert [threads[job] for job in jobs[:53]] == [1] * 53
    assert max(threads.values()) <= 8
    few = list(run(work, jobs[:2], cluster=ClusterSettings(workers=8)))
    assert sorted(one.result[3] for one in few) == [4, 4]


def test_a_closed_run_leaves_no_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    rows = run(work, ["well", *["hang"] * 9], cluster=ClusterSettings(workers=2, timeout=None))
    assert next(rows).job == "well"
    begun = time.monotonic()
    rows.close()
    assert time.monotonic() - begun < 3.0
    assert not [one for one in psutil.Process().children() if runs(one, "child_main")]
    assert list(tmp_path.iterdir()) == []


def test_kernels_are_compiled_before_the_first_job(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    monkeypatch.setattr(running, "warmup", lambda: order.append("compiled"))
    for compiled in (True, False):
        (done,) = run(work, ["well"], cluster=ClusterSettings(workers=1), compiled=compiled)
        order.append(done.job)
    assert order == ["compiled", "well", "well"]
    assert list(run(work, [], cluster=ClusterSettings(), compiled=True)) == []
    assert len(order) == 3


def test_workers_are_limited_by_processors_and_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "_CONTROL_GROUPS", tmp_path)
    (tmp_path / "memory").mkdir()
    machine = psutil.virtual_memory().total / 1e9
    for name in ("memory.high", "memory/memory.limit_in_bytes", "memory.max"):
        for text, limit in {"max": machine, "0": machine, "8000000000": 8.0}.items():
            (tmp_path / name).write_text(f"{text}\n", encoding="ascii")
            assert machine_memory() == min(machine, limit)
        (tmp_path / name).unlink()
    monkeypatch.setattr(running, "machine_memory", lambda: 8.0)
    monkeypatch.setattr(running, "available_processors", lambda: 64)
    for limit, count in {None: int(USABLE_MEMORY * 8.0 / 0.5), 3.0: 2, 30.0: 1}.items():
        assert local_workers(ClusterSettings(worker_memory=limit)) == count
    assert local_workers(ClusterSettings(workers=5, worker_memory=3.0)) == 5
    monkeypatch.setattr(running, "available_processors", lambda: 3)
    assert local_workers(ClusterSettings()) == 3


SCRIPT = """
import sys, threading
from grasp3d.jobs import ClusterSettings
from grasp3d.jobs.running import run

def twice(number):
    return number * 2

def main():
    rows = run(twice, range(5), cluster=ClusterSettings(workers=1))
    print(sorted(row.result for row in rows), "distributed" in sys.modules, flush=True)

if sys.argv[1:] == ["thread"]:
    thread = threading.Thread(target=main)
    thread.start()
    thread.join()
else:
    main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["-c", SCRIPT], ["script.py", "thread"]])
def test_a_script_needs_no_main_guard_and_no_dask(tmp_path: Path, arguments: list[str]) -> None:
    (tmp_path / "script.py").write_text(SCRIPT, encoding="ascii")
    with started(*arguments, cwd=tmp_path) as script:
        assert script.communicate(timeout=20.0) == ("[0, 2, 4, 6, 8] False\n", "")


def started(*arguments: str, cwd: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-W", "error", *arguments], cwd=cwd, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(Path(grasp3d.__file__).parents[1])},
    )  # fmt: skip


CLIENT = """
import os, signal, subprocess, sys, time
from grasp3d.jobs import ClusterSettings
from grasp3d.jobs.running import run

def task(job):  # starts a process that sleeps, and sleeps itself
    if job:
        with open(f"{job}.ids", "w") as file:
            print(os.getpid(), subprocess.Popen(["sleep", "60"]).pid, file=file)
        time.sleep(60)

where = sys.argv[1:]
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
cluster = ClusterSettings(scheduler=where[0]) if where else ClusterSettings(workers=2)
try:
    for row in run(task, range(9), cluster=cluster):
        print("begun", flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "signum"),
    [("here", signal.SIGKILL), ("here", signal.SIGINT), ("dask", signal.SIGKILL)],
)
def test_jobs_and_what_they_started_end_with_their_client(
    tmp_path: Path, where: str, signum: signal.Signals
) -> None:
    with ExitStack() as stack:
        options, cluster = [], ClusterSettings(workers=1)
        if where == "dask":
            dask = stack.enter_context(DaskCluster(tmp_path))
            dask.worker()
            options, cluster = [str(dask.file)], ClusterSettings(scheduler=str(dask.file))
        with started("-c", CLIENT, *options, cwd=tmp_path) as client:
            assert client.stdout is not None
            assert client.stdout.readline() == "begun\n"
            ids = wait_for(lambda: [int(word) for path in tmp_path.glob("*.ids")
                                    for word in path.read_text().split()])  # fmt: skip
            client.send_signal(signum)
            begun = time.monotonic()
            output, errors = client.communicate(timeout=10.0)
            for pid in ids:
                wait_for(partial(has_ended, pid), 5.0)
            assert time.monotonic() - begun < 5.0
        assert (output, errors) == ("interrupted\n" * (signum == signal.SIGINT), "")
        (done,) = run(work, ["well"], cluster=cluster)  # a worker of Dask still works
        assert done.error is None
