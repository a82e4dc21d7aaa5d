"""`grasp3d batch` run as a command: with child processes, interrupted, killed and resumed."""

import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from grasp3d import open_library
from tests.helpers import shapes
from tests.helpers.commands import COMMAND, export, run_here, run_process
from tests.helpers.dask_cluster import wait_for
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


def resumed(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """The same command again, in this process: who labels the rest does not change the rows."""
    return run_here("batch", "in", "-o", "out", "--workers", "0", *OPTIONS, *options, cwd=folder)


def make_library(folder: Path, count: int = 10) -> Path:
    """Write eggs of different lengths."""
    vertices, faces = shapes.sphere(2)
    for number in range(count):
        size = (1.0, 1.0, 1.1 + 0.1 * number)
        export(folder / f"egg_{number}.ply", (vertices * size, faces))
    return folder


def rows_of(output: Path) -> list[dict[str, Any]]:
    """Rows without the columns that differ between runs."""
    rows = open_library(output).table().to_pylist()
    return [{key: str(row[key]) for key in row if key not in TIMINGS} for row in rows]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library and its results without interruptions."""
    folder = tmp_path_factory.mktemp("undisturbed")
    make_library(folder / "in")
    run = run_process("batch", "in", "-o", "out", *OPTIONS, cwd=folder)
    lines = run.stderr.splitlines()
    assert (run.returncode, lines[0]) == (0, "10 meshes to label, 0 finished before")
    assert lines[-1].startswith("10 labelled, 0 failed, 0 left")
    assert "\x1b" not in run.stderr
    assert "10 labelled, 0 failed\n" in run.stdout
    return folder


@pytest.mark.slow
def test_failures_do_not_end_the_batch(tmp_path: Path) -> None:
    make_library(tmp_path / "in", 1)
    export(tmp_path / "in" / "deep" / "box.stl", shapes.box())
    for name in ("bad.obj", "deep/bad.obj"):
        (tmp_path / "in" / name).write_text("nonsense", encoding="ascii")
    options = ("--friction", "1", "--workers", "1", *OPTIONS)
    run = run_process("batch", "in", "-o", "out", *options, cwd=tmp_path)
    assert (run.returncode, "Traceback" in run.stderr) == (1, False)
    assert run.stderr.count("holds no triangles") == 1  # the first of each reason, at once
    assert run.stdout.count("holds no triangles") == 2
    assert "2 labelled, 2 failed" in run.stdout
    rows = {row["mesh"]: row for row in open_library(tmp_path / "out").table().to_pylist()}
    assert rows["egg_0.ply"]["stable"] == pytest.approx(1.0)
    assert rows["deep/box.stl"]["surface"] == "surfaces/deep/box.stl.ply"
    assert "holds no triangles" in rows["bad.obj"]["error"]
    quiet = resumed(tmp_path, "--friction", "1", "-q")
    assert (quiet.returncode, quiet.stdout) == (1, "")
    assert re.fullmatch(r"(failed: in/(deep/)?bad\.obj: .*\n){2}", quiet.stderr)
    shown = {path.name for path in (tmp_path / "out").iterdir() if path.name[0] != "."}
    assert shown == {"labels", "surfaces", "report"}


@pytest.mark.slow
def test_strictly_a_mesh_with_warnings_fails_and_only_then(tmp_path: Path) -> None:
    library = make_library(tmp_path / "in", 1)
    vertices, faces = shapes.box()
    export(library / "open.stl", (vertices, faces[1:]))

    def labelled() -> int:
        return sum(not row["error"] for row in rows_of(tmp_path / "out"))

    assert (resumed(tmp_path).returncode, labelled()) == (0, 2)
    for options in ((), ("--workers", "1")):
        strict = resumed(tmp_path, "--strict", *options)
        assert (strict.returncode, labelled()) == (1, 1)
        assert re.search("failed: .*the surface is open", strict.stdout)
    assert (resumed(tmp_path).returncode, labelled()) == (0, 2)


@pytest.mark.slow
def test_the_same_command_again_labels_nothing_and_options_change_nothing_else(
    undisturbed: Path,
) -> None:
    before = rows_of(undisturbed / "out")
    run = resumed(undisturbed)
    assert run.returncode == 0
    assert "10 labelled, 0 failed; 10 of them were finished before" in run.stdout
    quiet = resumed(undisturbed, "-q")
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")
    assert rows_of(undisturbed / "out") == before
    for part in ("1/2", "2/2"):
        words = ("--surfaces", "tar", "--part", part, "-q")
        command = ("batch", "in", "-o", "parts", "--workers", "0", *OPTIONS, *words)
        assert run_here(*command, cwd=undisturbed).returncode == 0
    assert len(list((undisturbed / "parts" / "surfaces").iterdir())) == 2
    found, expected = (
        [{**row, "surface": ""} for row in rows]
        for rows in (rows_of(undisturbed / "parts"), before)
    )
    assert found == expected


@pytest.mark.slow
def test_an_interrupted_or_killed_batch_is_resumed(undisturbed: Path, tmp_path: Path) -> None:
    (tmp_path / "in").symlink_to(undisturbed / "in")
    command = (str(COMMAND), "batch", "in", "-o", "out", "--workers", "1", *OPTIONS)
    output, done = tmp_path / "out", 0
    for signum in (signal.SIGINT, signal.SIGKILL, signal.SIGTERM):
        before = {path: path.stat().st_mtime_ns for path in output.glob("surfaces/*")}

        def has_begun(before: dict[Path, int] = before) -> bool:
            made = [one for one in output.glob("surfaces/*.ply") if one not in before]
            again = [one for one in before if one.stat().st_mtime_ns != before[one]]
            return len(made + again) >= 2

        with started(*command, cwd=tmp_path) as run:
            wait_for(lambda: has_begun() or run.poll() is not None, 120.0)
            os.killpg(run.pid, signum)
            time.sleep(0.05)
            with suppress(ProcessLookupError):  # an impatient user
                os.killpg(run.pid, signum)
            printed, errors = run.communicate(timeout=30)
        assert (printed, "Traceback" in errors) == ("", False)
        found = len(rows_of(output))
        if signum == signal.SIGKILL:
            assert found == done
            continue
        assert run.returncode == 130
        text = (
            r"\d labelled, 0 failed, \d left; finished meshes are stored; the same command labels"
        )
        assert re.search(f"interrupted: {text} the others", errors)
        assert done or not list(output.rglob("*.part*"))
        assert done + 2 <= found < 10
        done = found
    again = resumed(tmp_path)
    assert f"; {done} of them were finished before" in again.stdout
    assert rows_of(output) == rows_of(undisturbed / "out")


@pytest.mark.slow
def test_a_missing_scheduler_is_an_error_of_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp3d.jobs.cluster.CONNECT_TIMEOUT", 0.5)
    make_library(tmp_path / "in", 2)
    run = run_here("batch", "in", "-o", "out", "--scheduler", "tcp://127.0.0.1:1", cwd=tmp_path)
    *before, last = run.stderr.splitlines()
    assert (run.returncode, before) == (2, ["2 meshes to label, 0 finished before"])
    assert last.startswith("grasp3d: ")
    assert "127.0.0.1:1" in last
