"""Jobs on a Dask cluster: what is lost with workers, schedulers, and other environments."""

import logging
import os
import re
import threading
from functools import partial
from pathlib import Path

import psutil
import pytest

from grasp3d import GraspError
from grasp3d.errors import SettingError
from grasp3d.jobs import ClusterSettings, cluster
from grasp3d.jobs.running import Done, run
from tests.helpers.dask_cluster import PATHS, ROOT, DaskCluster, runs, wait_for
from tests.helpers.jobs import work

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")]

FEW_DEATHS = {**PATHS, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
"""Environment of a cluster that gives up a task when its worker has died twice."""


def on(running: DaskCluster | str) -> ClusterSettings:
    return ClusterSettings(scheduler=running if isinstance(running, str) else str(running.file))


def test_killed_workers_lose_no_jobs(tmp_path: Path) -> None:
    jobs = [f"well-{number}" for number in range(30)]
    with DaskCluster(tmp_path, FEW_DEATHS) as running:
        nannies, done = [running.worker(), running.worker()], []
        for one in run(partial(work, pause=0.1), jobs, cluster=on(running)):
            done.append(one)
            if len(done) == 6:
                for process in psutil.Process(nannies[0].pid).children():
                    if runs(process, "spawn_main"):
                        process.kill()
            if len(done) == 12:
                nannies[1].kill()
        assert sorted(one.job for one in done) == sorted(jobs)
        assert [one for one in done if one.error] == []
        (deadly,) = run(work, ["kills its worker"], cluster=on(running))
        assert str(deadly.error) == "was lost with its Dask worker 2 times"
        (well,) = run(work, ["well"], cluster=on(running))
        assert well.error is None


def test_a_cluster_without_workers_is_waited_for_but_a_dead_scheduler_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(cluster, "NO_WORKER_WARNING", 0.2)
    monkeypatch.setattr(cluster, "REFRESH", 0.1)
    jobs = [f"well-{number}" for number in range(5)]
    rows: list[Done[str, object]] = []
    errors: list[GraspError] = []

    def collect() -> None:
        try:
            rows.extend(run(work, jobs, cluster=on(running)))
            rows.extend(run(work, [*jobs, *["hang"] * 9], cluster=on(running)))
        except GraspError as error:
            errors.append(error)

    with caplog.at_level(logging.WARNING), DaskCluster(tmp_path) as running:
        thread = threading.Thread(target=collect)
        thread.start()
        wait_for(lambda: "waiting for one" in caplog.text)
        assert not rows
        running.worker("--no-nanny")
        wait_for(lambda: len(rows) >= 10)
        running.scheduler.kill()
        thread.join(10.0)
        assert not thread.is_alive()
    assert str(errors[0]) == (
        f"{running.file}: the Dask scheduler is gone; start it again, then this command"
    )


def test_what_cannot_run_the_jobs_is_an_error_of_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workers and scheduler must run the versions of this process."""
    info = tmp_path / "old" / "grasp3d-0.0.1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: grasp3d\nVersion: 0.0.1\n")
    old = {"PYTHONPATH": os.pathsep.join([str(info.parent), str(ROOT)])}
    for name in ("bare", "one", "two"):
        (tmp_path / name).mkdir()
    (tmp_path / "bare" / "sitecustomize.py").write_text(
        "import sys\nsys.modules['grasp3d'] = None\n", encoding="ascii"
    )

    def refused(running: DaskCluster | str, match: str) -> None:
        with pytest.raises(SettingError, match=match) as caught:
            list(run(work, ["well"], cluster=on(running)))
        assert "\n" not in str(caught.value)

    with (
        DaskCluster(tmp_path / "one") as running,
        DaskCluster(tmp_path / "two", {"PYTHONPATH": str(tmp_path / "bare")}) as bare,
    ):
        running.worker("--no-nanny", environment=old)
        refused(running, r"has grasp3d 0\.0\.1, .*the same environment")
        refused(bare, r"ModuleNotFoundError.*the same env")
        log = next(iter((tmp_path / "one").glob("worker-*.log"))).read_text()
        (address,) = set(re.findall(r"Start worker at: +(\S+)", log))
        refused(address, "is the address of a Dask Worker; give the scheduler's address")
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 0.5)
    refused("tcp://127.0.0.1:1", "no Dask scheduler responds at this address")
    refused(str(tmp_path / "no.json"), "is not a scheduler file")
