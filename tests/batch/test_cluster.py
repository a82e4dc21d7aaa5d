import json
import logging
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import psutil
import pytest
import trimesh

from grasp3d import GraspError
from grasp3d.batch import cluster
from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.run import run
from grasp3d.errors import SettingError
from tests.helpers.dask_cluster import PATHS, ROOT, DaskCluster, descendants, runs, wait_for
from tests.helpers.jobs import Done, Work, lost, work

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")

STRICT = {**PATHS, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
"""Environment of a cluster that gives up every task whose worker dies."""


def rows_of(jobs: list[Work], running: DaskCluster, pause: float = 0.0) -> Iterator[Done]:
    return run(work, jobs, pause, lost=lost, cluster=ClusterSettings(scheduler=str(running.file)))


def children(nanny: "subprocess.Popen[bytes]", word: str) -> list[psutil.Process]:
    return [process for process in descendants(nanny.pid) if runs(process, word)]


def has_ended(process: psutil.Process) -> bool:
    try:
        return bool(process.status() == psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return True


@pytest.mark.slow
def test_killed_workers_do_not_lose_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = [Work(f"well-{number}") for number in range(30)]
    jobs[4:4] = [Work("crash"), Work("killed once", tmp_path), Work("raises")]
    with DaskCluster(tmp_path, STRICT) as running:
        nannies = [running.worker(), running.worker()]
        expected = {row.name: row.reason for row in rows_of(jobs, running)}
        assert sum(map(bool, expected.values())) == 2
        (tmp_path / "killed once.begun").unlink()
        rows = []
        for row in rows_of(jobs, running, 0.1):
            rows.append(row)
            if len(rows) == 6:
                for process in psutil.Process(nannies[0].pid).children():
                    if runs(process, "spawn_main"):
                        process.kill()
            if len(rows) == 12:
                nannies[1].kill()
        assert len(rows) == len(jobs)
        assert {row.name: row.reason for row in rows} == expected
        monkeypatch.setattr("grasp3d.batch.run.MAX_WORKER_DEATHS", 1)
        jobs = [Work("kills its worker"), Work("well")]
        deadly, *_ = sorted(rows_of(jobs, running), key=lambda row: row.name)
        assert deadly.reason == "2 Dask workers died while they ran this mesh"


CLIENT = """
import sys
from grasp3d.batch.run import run
from grasp3d.batch.batch_settings import ClusterSettings
from tests.helpers.jobs import Work, lost, work
jobs = [Work("well"), *(Work(f"hang-{number}") for number in range(9))]
for row in run(work, jobs, 0.0, lost=lost, cluster=ClusterSettings(scheduler=sys.argv[1])):
    print(row.name, flush=True)
"""


@pytest.mark.slow
def test_running_jobs_end_with_their_client(tmp_path: Path) -> None:
    with DaskCluster(tmp_path) as running:
        nanny = running.worker()
        for signum in (signal.SIGKILL, signal.SIGINT):
            client = subprocess.Popen(
                [sys.executable, "-c", CLIENT, str(running.file)],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                cwd=ROOT,
            )
            with client:
                assert client.stdout is not None
                assert client.stdout.readline() == b"well\n"
                time.sleep(0.2)
                (child,) = children(nanny, "worker_main")
                client.send_signal(signum)
                begun = time.monotonic()
                wait_for(partial(has_ended, child))
                assert time.monotonic() - begun < 3.0
        (row,) = rows_of([Work("well")], running)  # the worker itself still works
        assert row.memory == pytest.approx(0.9 * 2.0)


@pytest.mark.slow
def test_a_cluster_without_workers_is_waited_for_but_a_dead_scheduler_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(cluster, "NO_WORKER_WARNING", 0.2)
    monkeypatch.setattr(cluster, "REFRESH", 0.1)
    jobs = [Work(f"well-{number}") for number in range(5)] + [Work("hang")] * 9
    rows: list[Done] = []
    errors: list[GraspError] = []

    def collect() -> None:
        try:
            rows.extend(rows_of(jobs[:5], running))
            rows.extend(rows_of(jobs, running))
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
        thread.join(5.0)
        assert not thread.is_alive()
    assert "the Dask scheduler is gone" in str(errors[0])
    assert "\n" not in str(errors[0])


@pytest.mark.slow
def test_other_environments_are_an_error_of_one_line(tmp_path: Path) -> None:
    """Workers and scheduler must run the versions of this process."""
    info = tmp_path / "old" / "grasp3d-0.0.1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: grasp3d\nVersion: 0.0.1\n")
    old = {"PYTHONPATH": os.pathsep.join([str(info.parent), str(ROOT)])}
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "sitecustomize.py").write_text(
        "import sys\nsys.modules['grasp3d'] = None\n", encoding="ascii"
    )
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    with (
        DaskCluster(tmp_path / "one") as running,
        DaskCluster(tmp_path / "two", {"PYTHONPATH": str(tmp_path / "bare")}) as bare,
    ):
        running.worker("--no-nanny", environment=old)
        with pytest.raises(SettingError, match=r"runs grasp3d 0\.0\.1.*the same environment"):
            list(rows_of([Work("well")], running))
        with pytest.raises(SettingError, match=r"ModuleNotFoundError.*the same env") as missing:
            list(rows_of([Work("well")], bare))
        assert "\n" not in str(missing.value)
        worker = next(iter(Path(tmp_path / "one").glob("worker-*.log"))).read_text()
        (address,) = set(re.findall(r"Start worker at: +(\S+)", worker))
        with pytest.raises(SettingError, match="is the address of a Dask Worker"):
            next(run(work, [Work("")], 0.0, lost=lost, cluster=ClusterSettings(scheduler=address)))


def fake_command(folder: Path, name: str, text: str) -> None:
    """Write a command that imitates one of a SLURM cluster."""
    path = folder / "bin" / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="ascii")
    path.chmod(0o755)


SBATCH = """#!/bin/sh
cp "$1" "job-$$.sh" # whoever submits it removes it
setsid sh "job-$$.sh" > job.log 2>&1 &
echo $! >> jobs
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
kill -- "-$1"
"""
SRUN = """#!/bin/sh
while [ "${1#--}" != "$1" ]; do shift; done
"$@" > one.log 2>&1 & one=$!
"$@" > two.log 2>&1 & two=$!
trap 'kill $one $two' TERM
wait
"""
CHECK = """#!/bin/sh
# Labelling takes too long for a test; `check` uses the workers in the same way.
while [ "$1" != --scheduler ]; do shift; done
exec {python} -P -c 'import sys; from grasp3d.cli import main; sys.exit(main())' \
check meshes --quiet -o checked.json "$@"
"""


@pytest.fixture
def slurm(tmp_path: Path) -> Path:
    """A folder with meshes and the commands of a SLURM cluster."""
    (tmp_path / "meshes").mkdir()
    for number in range(2):
        trimesh.creation.box().export(tmp_path / "meshes" / f"{number}.stl")
    for name, text in {"sbatch": SBATCH, "scancel": SCANCEL, "squeue": "#!/bin/sh\n"}.items():
        fake_command(tmp_path, name, text)
    fake_command(tmp_path, "srun", SRUN)
    fake_command(tmp_path, "grasp3d", CHECK.format(python=sys.executable))
    fake_command(tmp_path, "dask", f'#!/bin/sh\nexec {sys.executable} -m dask "$@"\n')
    return tmp_path


def check_run(command: list[str], folder: Path) -> None:
    path = os.pathsep.join([str(folder / "bin"), os.environ["PATH"]])
    with (folder / "log").open("wb") as log:  # no pipe: processes left behind would keep it open
        done = subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, **PATHS, "PATH": path, "SLURM_JOB_ID": "7", "SLURM_NTASKS": "2"},
            stdout=log,
            stderr=log,
            timeout=180.0,
            check=False,
        )
    assert done.returncode == 0, (folder / "log").read_text()
    meshes = json.loads((folder / "checked.json").read_text(encoding="utf-8"))["meshes"]
    assert [mesh["mesh"] for mesh in meshes] == ["0.stl", "1.stl"]
    assert meshes[0]["trust"] == "yes"


@pytest.mark.slow
def test_the_script_of_the_guide_runs_in_one_job(slurm: Path) -> None:
    guide = (ROOT / "docs" / "guide" / "libraries.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```sh\n(#!/bin/bash\n.*?)```", guide, flags=re.DOTALL)
    (slurm / "job.sh").write_text(block.replace(".venv/bin/activate", "/dev/null"))
    check_run(["bash", "job.sh"], slurm)
