"""`grasp3d batch` run as a command: with child processes, interrupted, killed and resumed."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from grasp3d import open_library
from grasp3d.system.names import as_unicode, safe_stem
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
    for found in (done, 10):
        again = resumed(tmp_path)
        assert again.returncode == 0
        assert f"10 labelled, 0 failed; {found} of them were finished before" in again.stdout
    quiet = resumed(tmp_path, "-q")
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")
    assert rows_of(output) == rows_of(undisturbed / "out")


LONG = "é" * 123  # with its suffix 250 bytes
UNDECODABLE = os.fsdecode(b"mug\xff")
STEMS = ("ünï 物体 #1", "-rf", "a b", "[red]", "CON", LONG, "two\nlines", UNDECODABLE,
         ":apple: \\[b]")  # fmt: skip


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there are no such names")
def test_difficult_names_overwrite_no_mesh_and_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp3d.batch.object_page.can_render", lambda: False)
    meshes = [f"in/{stem}.stl" for stem in STEMS] + ["in/a/mug.stl", "in/b/mug.stl"]
    meshes += ["in/mug.stl", "in/mug.obj", "in/MUG.STL", "in/co:lon/x.ply", "far/mug.stl"]
    before = {}
    for name in meshes:
        before[name] = export(tmp_path / name, shapes.sphere(1)).read_bytes()
    (tmp_path / "in" / "bad\nfile.stl").touch()
    words = ("batch", "in", "far", "-o", "in", "--workers", "0", "--unit", "m", "--max-edge", "inf")
    run = run_here(*words, cwd=tmp_path)
    assert run.returncode == 1
    assert f"{len(meshes)} labelled, 1 failed" in run.stdout
    assert {name: (tmp_path / name).read_bytes() for name in meshes} == before
    rows = open_library(tmp_path / "in").table().to_pylist()
    made = {row["surface"] for row in rows if not row["error"]}
    assert len({name.casefold() for name in made}) == len(made) == len(meshes)
    assert all((tmp_path / "in" / name).is_file() for name in made)
    assert {f"surfaces/{safe_stem(as_unicode(f'{stem}.stl'))}.ply" for stem in STEMS} <= made
    assert {f"surfaces/{name}.ply" for name in ("a/mug.stl", "b/mug.stl", "mug.obj")} <= made
    for start in ("[red].stl ", ":apple: \\[b].stl ", "two\\nlines.stl "):
        assert any(line.startswith(start) for line in run.stdout.splitlines())
    assert "failed: in/bad\\nfile.stl: the file is empty; export the mesh again\n" in run.stdout
