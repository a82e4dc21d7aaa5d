import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

import grasp3d
from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.job_requests import USABLE_MEMORY, local_workers
from grasp3d.batch.run import run
from tests.helpers.dask_cluster import runs
from tests.helpers.jobs import Done, Work, lost, needs_2_gb, process_id, work

posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
TWO = ClusterSettings(workers=2, worker_memory=0.5, timeout=3.0)


def spans(log: Path) -> dict[str, tuple[float, float]]:
    """Start and end of the attempts that succeeded."""
    found = {}
    for path in log.iterdir():
        if path.suffix != ".begun":
            begun, ended = map(float, path.read_text(encoding="ascii").split())
            found[path.name] = (begun, ended)
    return found


FAULTS = {
    "crash": "crashed (segmentation fault)",
    "killed": "was killed from outside, most likely for lack of memory",
    "hang": "took longer than 3 s and was ended",
    "raises": "unexpected ValueError: an error of two lines; please report this mesh",
    "1e6 GB": "needs about 1e+06 GB of memory, more than its limit",
    "crash once": "",
    "killed once": "",
    "exceeds its limit": "",
    "0.7 GB": "",
    "0.4 GB": "",
}


@pytest.mark.slow
def test_nothing_is_left_in_the_temporary_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    rows = list(run(work, [Work("well")], 0.0, lost=lost, cluster=ClusterSettings(workers=1)))
    assert [row.reason for row in rows] == [""]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@posix
def test_failing_jobs_affect_no_others_and_postponed_jobs_run_alone(tmp_path: Path) -> None:
    names = [f"well-{number}" for number in range(20)]
    for number, fault in enumerate(FAULTS):
        names.insert(2 * number, fault)
    begun: list[str] = []
    jobs = [Work(name, tmp_path) for name in names]
    rows = list(
        run(work, jobs, 0.05, lost=lost, cluster=TWO, started=lambda job: begun.append(job.name))
    )
    assert begun == names
    assert sorted(row.name for row in rows) == sorted(names)
    reasons = {row.name: row.reason for row in rows}
    assert reasons == {name: FAULTS.get(name, "") for name in names}
    memory = {row.name: row.memory for row in rows if not row.reason}
    alone = {"killed once", "exceeds its limit", "0.7 GB"}
    assert {name for name, allowed in memory.items() if allowed != 0.5} == alone
    spans_of = spans(tmp_path)
    for name in alone:
        begin, end = spans_of[name]
        others = [span for other, span in spans_of.items() if other != name]
        assert all(ended < begin or started > end for started, ended in others)
        assert all(spans_of[other][1] < begin for other in names if other.startswith("well"))


@posix
def test_a_job_that_had_all_memory_is_given_up_at_once() -> None:
    one = ClusterSettings(workers=1, worker_memory=1e3, timeout=None)
    (row,) = run(work, [Work("0.7 GB")], 0.0, lost=lost, cluster=one)
    assert row.memory == 1e3
    (row,) = run(work, [Work("1e6 GB")], 0.0, lost=lost, cluster=one)
    assert row.reason.startswith("needs about")


def test_jobs_are_taken_as_they_are_needed() -> None:
    taken = itertools.count()
    begun: list[Work] = []

    def jobs() -> Iterator[Work]:
        yield from (Work(f"well-{number}") for number in taken)

    rows = run(work, jobs(), 0.0, lost=lost, cluster=TWO, started=begun.append)
    some = [row.name for row in itertools.islice(rows, 50)]
    rows.close()  # type: ignore[attr-defined]
    assert len(set(some)) == 50
    assert len(begun) == next(taken) <= 50 + 4 + 1
    assert not any(
        runs(process, "grasp3d.batch.worker_main") for process in psutil.Process().children()
    )


def test_without_child_processes_jobs_run_in_this_process() -> None:
    here = ClusterSettings(workers=0)
    begun: list[Work] = []
    jobs = [Work("well"), Work("raises"), Work("0.7 GB")]
    rows = list(run(work, iter(jobs), 0.0, lost=lost, cluster=here, started=begun.append))
    assert rows == [Done("well"), Done("raises", FAULTS["raises"]), Done("0.7 GB")]
    assert begun == jobs
    assert list(run(process_id, jobs[:1], 0.0, lost=lost, cluster=here)) == [Done(str(os.getpid()))]
    (row,) = run(needs_2_gb, jobs[:1], 0.0, lost=lost, cluster=here)
    assert row.reason == "needs about 2 GB of memory, more than its limit"


def test_an_error_of_the_job_iterator_ends_the_run() -> None:
    def jobs() -> Iterator[Work]:
        yield Work("well")
        raise OSError("the list of meshes is incomplete")

    with pytest.raises(OSError, match="is incomplete"):
        list(run(work, jobs(), 0.0, lost=lost, cluster=TWO))


LOCAL = """
import sys
from grasp3d.batch.run import run
from grasp3d.batch.batch_settings import ClusterSettings
from tests.helpers.jobs import Work, lost, work
rows = run(work, [Work("well")], 0.0, lost=lost, cluster=ClusterSettings(workers=1))
print(*(row.name for row in rows), "distributed" in sys.modules)
"""


@pytest.mark.slow
def test_jobs_on_this_machine_need_no_dask() -> None:
    script = started("-c", LOCAL, cwd=Path(grasp3d.__file__).parents[1])
    assert script.communicate(timeout=20.0) == ("well False\n", "")


def test_the_number_of_workers_is_limited_by_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp3d.batch.job_requests.machine_memory", lambda: 8.0)
    monkeypatch.setattr("grasp3d.batch.job_requests.available_processors", lambda: 64)
    assert local_workers(ClusterSettings()) == int(USABLE_MEMORY * 8.0 / 0.5)
    assert local_workers(ClusterSettings(worker_memory=3.0)) == 2
    assert local_workers(ClusterSettings(worker_memory=30.0)) == 1
    assert local_workers(ClusterSettings(workers=5, worker_memory=3.0)) == 5
    monkeypatch.setattr("grasp3d.batch.job_requests.available_processors", lambda: 3)
    assert local_workers(ClusterSettings()) == 3


SCRIPT = """
import os, threading, sys
from grasp3d.batch.run import run
from grasp3d.batch.batch_settings import ClusterSettings

def twice(number, by):
    return number * by

def main():
    rows = run(twice, range(5), 2, lost=print, cluster=ClusterSettings(workers=1))
    print(sorted(rows), flush=True)

if sys.argv[1:] == ["thread"]:
    thread = threading.Thread(target=main)
    thread.start()
    thread.join()
else:
    main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", ["file", "command", "thread"])
def test_a_script_needs_no_main_guard(tmp_path: Path, how: str) -> None:
    (tmp_path / "script.py").write_text(SCRIPT, encoding="ascii")
    arguments = ["-c", SCRIPT] if how == "command" else ["script.py"]
    arguments += ["thread"] if how == "thread" else []
    done = started(*arguments, cwd=tmp_path)
    assert done.communicate(timeout=20.0) == ("[0, 2, 4, 6, 8]\n", "")
    assert done.returncode == 0


def started(*arguments: str, cwd: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-W", "error", *arguments],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(grasp3d.__file__).parents[1])},
    )


INTERRUPTED = """
import psutil
from grasp3d.batch.run import run
from grasp3d.batch.batch_settings import ClusterSettings
from tests.helpers.jobs import Work, lost, work

jobs = [Work("well"), *(Work(f"hang-{number}") for number in range(9))]
try:
    for row in run(work, jobs, 0.2, lost=lost, cluster=ClusterSettings(workers=2)):
        print(*(child.pid for child in psutil.Process().children()), flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.slow
@posix
def test_an_interrupt_ends_all_processes_at_once_and_silently(tmp_path: Path) -> None:
    with started("-c", INTERRUPTED, cwd=tmp_path) as script:
        assert script.stdout is not None
        children = [int(word) for word in script.stdout.readline().split()]
        assert len(children) == 2
        script.send_signal(signal.SIGINT)
        begun = time.monotonic()
        assert script.communicate(timeout=10.0) == ("interrupted\n", "")
        assert time.monotonic() - begun < 3.0
    assert not any(psutil.pid_exists(child) for child in children)
