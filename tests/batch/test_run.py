import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import trimesh

import grasp3d
from grasp3d import GraspModel, Sampling
from grasp3d.batch.batch_settings import BatchSettings, ClusterSettings
from grasp3d.batch.checking import check_file, lost_check
from grasp3d.batch.cluster import local_workers
from grasp3d.batch.plan import MeshFile
from grasp3d.batch.run import run
from grasp3d.batch.working import KEPT
from tests.helpers import shapes
from tests.helpers.jobs import Done, Work, lost, needy, where, work

posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
TWO = ClusterSettings(workers=2, worker_memory=0.5, timeout=3.0)


def spans(log: Path) -> dict[str, tuple[float, float]]:
    """When the attempts that came to an end were at work."""
    found = {}
    for path in log.iterdir():
        if path.suffix != ".begun":
            begun, ended = map(float, path.read_text(encoding="ascii").split())
            found[path.name] = (begun, ended)
    return found


FAULTS = {
    "crash": "crashed (segmentation fault)",
    "killed": "was killed from outside, most likely for want of memory",
    "hang": "took longer than 3 s and was ended",
    "strange": "unexpected ValueError: no one thought of this; please report this mesh",
    "monstrous": "needs about 1e+06 GB of memory, more than it may take",
    "crash once": "",
    "killed once": "",
    "eats": "",
    "large": "",
    "modest": "",
}


@posix
def test_each_fault_costs_its_own_row_only_and_what_is_put_off_runs_alone(tmp_path: Path) -> None:
    names = [f"well-{number}" for number in range(20)]
    for place, fault in enumerate(FAULTS):
        names.insert(2 * place, fault)
    begun: list[str] = []
    jobs = [Work(name, tmp_path) for name in names]
    rows = list(
        run(work, jobs, 0.05, lost=lost, cluster=TWO, started=lambda job: begun.append(job.name))
    )
    assert begun == names
    assert sorted(row.name for row in rows) == sorted(names)
    told = {row.name: row.told for row in rows}
    assert told == {name: FAULTS.get(name, "") for name in names}
    memory = {row.name: row.memory for row in rows if not row.told}
    alone = {"killed once", "eats", "large"}
    assert {name for name, allowed in memory.items() if allowed != 0.5} == alone
    at_work = spans(tmp_path)
    for name in alone:
        begin, end = at_work[name]
        others = [span for other, span in at_work.items() if other != name]
        assert all(ended < begin or started > end for started, ended in others)
        assert all(at_work[other][1] < begin for other in names if other.startswith("well"))


@posix
def test_what_is_insatiable_is_given_up_at_once_where_it_had_all_there_is() -> None:
    one = ClusterSettings(workers=1, worker_memory=1e3, timeout=None)
    (row,) = run(work, [Work("large")], 0.0, lost=lost, cluster=one)
    assert row.memory == 1e3
    (row,) = run(work, [Work("monstrous")], 0.0, lost=lost, cluster=one)
    assert row.told.startswith("needs about")


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
    left = [process.cmdline() for process in psutil.Process().children() if process.is_running()]
    assert not any("grasp3d.isolation.child" in words for words in left)


def test_no_jobs_are_no_rows() -> None:
    assert list(run(work, [], 0.0, lost=lost, cluster=TWO)) == []


def test_without_processes_the_work_is_done_here() -> None:
    here = ClusterSettings(workers=0)
    begun: list[Work] = []
    jobs = [Work("well"), Work("strange"), Work("large")]
    rows = list(run(work, iter(jobs), 0.0, lost=lost, cluster=here, started=begun.append))
    assert rows == [Done("well"), Done("strange", FAULTS["strange"]), Done("large")]
    assert begun == jobs
    assert list(run(where, jobs[:1], 0.0, lost=lost, cluster=here)) == [Done(str(os.getpid()))]
    (row,) = run(needy, jobs[:1], 0.0, lost=lost, cluster=here)
    assert row.told == "needs about 2 GB of memory, more than it may take"


def test_jobs_that_cannot_be_taken_end_the_run_with_their_error() -> None:
    def jobs() -> Iterator[Work]:
        yield Work("well")
        raise OSError("the list of meshes broke off")

    with pytest.raises(OSError, match="broke off"):
        list(run(work, jobs(), 0.0, lost=lost, cluster=TWO))


def test_as_many_jobs_at_once_as_there_is_memory_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp3d.batch.cluster.MEMORY_LIMIT", 8e9)
    monkeypatch.setattr("grasp3d.batch.cluster.available_processors", lambda: 64)
    assert local_workers(ClusterSettings()) == int(KEPT * 8.0 / 0.5)
    assert local_workers(ClusterSettings(worker_memory=3.0)) == 2
    assert local_workers(ClusterSettings(worker_memory=30.0)) == 1
    assert local_workers(ClusterSettings(workers=5, worker_memory=3.0)) == 5
    monkeypatch.setattr("grasp3d.batch.cluster.available_processors", lambda: 3)
    assert local_workers(ClusterSettings()) == 3


SCRIPT = """
import os, threading, sys
from grasp3d.batch.run import run
from grasp3d.batch.batch_settings import ClusterSettings

def twice(number, by):
    return number * by

def go():
    rows = run(twice, range(5), 2, lost=print, cluster=ClusterSettings(workers=1))
    print(sorted(rows), flush=True)

if sys.argv[1:] == ["thread"]:
    thread = threading.Thread(target=go)
    thread.start()
    thread.join()
else:
    go()
"""


@pytest.mark.parametrize("how", ["file", "command", "thread"])
def test_a_script_needs_no_guard(tmp_path: Path, how: str) -> None:
    (tmp_path / "script.py").write_text(SCRIPT, encoding="ascii")
    words = ["-c", SCRIPT] if how == "command" else ["script.py"]
    words += ["thread"] if how == "thread" else []
    done = started(*words, cwd=tmp_path)
    assert done.communicate(timeout=20.0) == ("[0, 2, 4, 6, 8]\n", "")
    assert done.returncode == 0


def started(*words: str, cwd: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-W", "error", *words],
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


@posix
def test_an_interrupt_ends_all_at_once_and_silently(tmp_path: Path) -> None:
    with started("-c", INTERRUPTED, cwd=tmp_path) as script:
        assert script.stdout is not None
        children = [int(word) for word in script.stdout.readline().split()]
        assert len(children) == 2
        script.send_signal(signal.SIGINT)
        begun = time.monotonic()
        assert script.communicate(timeout=10.0) == ("interrupted\n", "")
        assert time.monotonic() - begun < 3.0
    assert not any(psutil.pid_exists(child) for child in children)


def test_a_run_in_a_thread_beside_another() -> None:
    found: list[list[str]] = []

    def go() -> None:
        jobs = [Work(f"well-{number}") for number in range(4)]
        rows = run(work, jobs, 0.02, lost=lost, cluster=ClusterSettings(workers=1))
        found.append(sorted(row.name for row in rows))

    threads = [threading.Thread(target=go) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [[f"well-{number}" for number in range(4)]] * 2


@pytest.mark.slow
def test_meshes_are_checked_in_little_memory_as_here(tmp_path: Path) -> None:
    """The compiled loops, Embree and Manifold live with what a small worker may take."""
    trimesh.Trimesh(*shapes.sphere(3), process=False).export(tmp_path / "ball.ply")
    (tmp_path / "bad.stl").write_text("no mesh", encoding="ascii")
    files = [MeshFile(name, str(tmp_path / name)) for name in ("ball.ply", "bad.stl")]
    settings = BatchSettings(GraspModel(edges=8), Sampling(rays=16))
    rows = run(check_file, files, settings, lost=lost_check, cluster=ClusterSettings(1, None, 0.6))
    ball, bad = sorted(rows, key=lambda row: row.refusal)
    assert bad.refusal == check_file(files[1], settings).refusal
    here = check_file(files[0], settings)
    assert ball.diagnosis is not None
    assert here.diagnosis is not None
    assert (ball.diagnosis.size, ball.diagnosis.trust) == (here.diagnosis.size, here.trust)
