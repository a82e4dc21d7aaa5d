"""`grasp3d batch` run as a command: with child processes, interrupted and resumed."""

import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import trimesh

from tests.helpers import shapes
from tests.helpers.commands import COMMAND, run_here, run_process
from tests.helpers.jobs import TIMINGS

OPTIONS = ("--max-edge", "0.3")


@contextmanager
def started(*command: str, cwd: Path) -> Iterator[subprocess.Popen[str]]:
    """A process in a group of its own, which is killed at the end."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=cwd,
        start_new_session=True,
    )  # fmt: skip
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def wait_for(condition: Callable[[], object], seconds: float = 120.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def resumed(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """The same command again, in this process: who labels the rest does not change the rows."""
    return run_here("batch", "in", "-o", "out", "--workers", "0", *OPTIONS, *options, cwd=folder)


def make_library(folder: Path, count: int = 10) -> Path:
    """Write eggs of different lengths."""
    folder.mkdir()
    vertices, faces = shapes.sphere(2)
    for number in range(count):
        egg = trimesh.Trimesh(vertices * (1.0, 1.0, 1.1 + 0.1 * number), faces, process=False)
        egg.export(folder / f"egg_{number}.ply")
    return folder


def labelled(output: Path) -> int:
    return len(list((output / "labels").glob("*.ply")))


def summary(output: Path) -> list[dict[str, Any]]:
    """Rows without the columns that differ between runs."""
    rows = pd.read_parquet(output / "summary").sort_values("mesh")
    assert rows["mesh"].is_unique
    return [
        {key: str(value) for key, value in row.items() if key not in TIMINGS}
        for row in rows.to_dict("records")
    ]


def check_no_unfinished_files(output: Path) -> None:
    assert not [path for path in output.rglob("*") if ".part" in path.name]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library and its results without interruptions."""
    folder = tmp_path_factory.mktemp("undisturbed")
    make_library(folder / "in")
    run = run_process("batch", "in", "-o", "out", *OPTIONS, cwd=folder)
    (folder / "stderr").write_text(run.stderr, encoding="utf-8")
    assert (run.returncode, run.stderr.count("Traceback")) == (0, 0)
    assert "10 labelled, 0 failed" in run.stdout
    return folder


@pytest.mark.slow
def test_without_a_terminal_progress_is_plain_lines(undisturbed: Path) -> None:
    stderr = (undisturbed / "stderr").read_text(encoding="utf-8")
    assert stderr.splitlines()[-1] == "10 labelled, 0 failed, 0 left"
    assert "\x1b" not in stderr
    assert "10 meshes to label, 0 finished before" in stderr
    quiet = resumed(undisturbed, "-q")
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")


@pytest.mark.slow
def test_failures_do_not_end_the_batch(tmp_path: Path) -> None:
    make_library(tmp_path / "in", 1)
    (tmp_path / "in" / "deep").mkdir()
    trimesh.Trimesh(*shapes.box()).export(tmp_path / "in" / "deep" / "box.stl")
    (tmp_path / "in" / "bad.obj").write_text("nonsense", encoding="ascii")
    options = ("--friction", "1", "--workers", "1", *OPTIONS)
    run = run_process("batch", "in", "-o", "out", *options, cwd=tmp_path)
    assert run.returncode == 1
    assert "2 labelled, 1 failed" in run.stdout
    assert "Traceback" not in run.stderr
    rows = pd.read_parquet(tmp_path / "out" / "summary").set_index("mesh")
    assert rows.loc["egg_0.ply", "stable"] == pytest.approx(1.0)
    assert 0.0 < rows.loc["egg_0.ply", "epsilon_min_p50"] < rows.loc["egg_0.ply", "epsilon_p50"]
    assert rows.loc["deep/box.stl", "labels"] == "labels/deep/box.ply"
    assert "holds no triangles" in rows.loc["bad.obj", "error"]
    quiet = resumed(tmp_path, "--friction", "1", "-q")
    assert (quiet.returncode, quiet.stdout) == (1, "")
    assert quiet.stderr.startswith("failed: in/bad.obj: ")
    assert quiet.stderr.count("\n") == 1
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        ".lock", "fields", "labels", "report", "summary"
    ]  # fmt: skip


@pytest.mark.slow
def test_strictly_a_mesh_with_warnings_fails_and_only_then(tmp_path: Path) -> None:
    library = make_library(tmp_path / "in", 2)
    (library / "egg_1.ply").unlink()
    vertices, faces = shapes.box()
    trimesh.Trimesh(vertices, faces[1:], process=False).export(library / "open.stl")
    assert resumed(tmp_path).returncode == 0
    assert labelled(tmp_path / "out") == 2
    for options in ((), ("--workers", "1")):
        strict = resumed(tmp_path, "--strict", *options)
        assert strict.returncode == 1
        assert "failed: " in strict.stdout
        assert "the surface is open" in strict.stdout
        assert labelled(tmp_path / "out") == 1
    assert resumed(tmp_path).returncode == 0
    assert labelled(tmp_path / "out") == 2


@pytest.mark.slow
def test_the_same_command_again_labels_nothing(undisturbed: Path) -> None:
    before = summary(undisturbed / "out")
    run = resumed(undisturbed)
    assert run.returncode == 0
    assert "10 labelled, 0 failed; 10 of them were finished before" in run.stdout
    assert summary(undisturbed / "out") == before


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT])
def test_an_interrupted_batch_prints_how_to_resume_and_resumes(
    undisturbed: Path, tmp_path: Path, how: signal.Signals
) -> None:
    (tmp_path / "in").symlink_to(undisturbed / "in")
    command = (str(COMMAND), "batch", "in", "-o", "out", "--workers", "1", *OPTIONS)
    with started(*command, cwd=tmp_path) as run:
        wait_for(lambda: labelled(tmp_path / "out") >= 3 or run.poll() is not None)
        os.killpg(run.pid, how)
        time.sleep(0.05)
        with suppress(ProcessLookupError):  # an impatient user
            os.killpg(run.pid, how)
        output, errors = run.communicate(timeout=30)
    assert (run.returncode, output) == (130, "")
    assert re.search(r"interrupted: \d of 10 meshes are done; labelled meshes are stored", errors)
    assert "Traceback" not in errors
    rows = summary(tmp_path / "out")
    assert 2 <= len(rows) < 10
    check_no_unfinished_files(tmp_path / "out")
    again = resumed(tmp_path)
    assert f"; {len(rows)} of them were finished before" in again.stdout
    assert summary(tmp_path / "out") == summary(undisturbed / "out")


@pytest.mark.slow
def test_a_missing_scheduler_is_an_error_of_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp3d.batch.cluster.CONNECT_TIMEOUT", 0.5)
    make_library(tmp_path / "in", 2)
    run = run_here("batch", "in", "-o", "out", "--scheduler", "tcp://127.0.0.1:1", cwd=tmp_path)
    *before, last = run.stderr.splitlines()
    assert (run.returncode, before) == (2, ["2 meshes to label, 0 finished before"])
    assert last.startswith("grasp3d: ")
    assert "127.0.0.1:1" in last
