"""The time limit of label and view."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from grasp3d.cli.time_limit import TimeLimited, TimeLimitError, time_limit
from grasp3d.errors import SettingError
from grasp3d.system.context import begin_step, recorded_steps
from tests.helpers import mesh_files
from tests.helpers.commands import run_here
from tests.helpers.mesh_files import written


def busy(name: str, seconds: float) -> None:
    begin_step(name)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pass


def test_the_message_names_the_steps_and_their_times() -> None:
    started = time.monotonic()

    def work() -> None:
        with time_limit(0.3, "a.stl"):
            busy("reading the mesh", 0.1)
            busy("repairing the surface", 60.0)

    with pytest.raises(TimeLimitError, match=r"^a\.stl: took longer than 0\.3 s") as end:
        work()
    assert time.monotonic() - started < 30.0
    assert "reading the mesh 0.1 s, repairing the surface 0." in str(end.value)
    assert " s and not finished; simplify the mesh" in str(end.value)


def test_the_limit_holds_where_another_library_handles_interrupts() -> None:
    before = signal.signal(signal.SIGINT, lambda *_: sys.exit())
    try:
        with pytest.raises(TimeLimitError), time_limit(0.1, "a.stl"):
            busy("reading the mesh", 60.0)
        assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_work_within_the_limit_is_not_disturbed() -> None:
    for limit in (60.0, None):
        with time_limit(limit, "a.stl"):
            busy("reading the mesh", 0.01)
    with pytest.raises(ZeroDivisionError), time_limit(60.0, "a.stl"):
        raise ZeroDivisionError
    with pytest.raises(KeyboardInterrupt), time_limit(60.0, "a.stl"):
        raise KeyboardInterrupt  # of the user


def test_a_step_that_comes_again_adds_to_its_time() -> None:
    with recorded_steps() as times:
        for name in ("searching", "measuring", "searching"):
            busy(name, 0.02)
    assert list(times.seconds) == ["searching", "measuring"]
    assert times.seconds["searching"] >= 0.04
    busy("outside", 0.0)
    assert "outside" not in str(times)


STUCK = """
import signal, time
from grasp3d.cli.time_limit import time_limit
from grasp3d.system.context import begin_step, recorded_steps
signal.signal(signal.SIGINT, signal.SIG_IGN)  # like compiled code, which does not see it
with time_limit(0.1, "a.stl"):
    begin_step("searching for grasps")
    time.sleep(100.0)
"""


@pytest.mark.slow
def test_a_computation_that_cannot_be_interrupted_is_ended_with_its_process() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", STUCK], capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 2
    assert "a.stl: took longer than 0.1 s" in ended.stderr
    assert "searching for grasps" in ended.stderr


@pytest.mark.slow
@pytest.mark.parametrize("command", ["label", "view"])
def test_commands_end_with_the_message_and_leave_no_file(
    tmp_path: Path, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def endless(*_: object, **__: object) -> None:
        busy("repairing the surface", 60.0)

    monkeypatch.setattr("grasp3d.mesh.preparing.repair_surface", endless)
    written(tmp_path, "a.off", mesh_files.off_text())
    output = ["--output", "a.ply"] if command == "label" else ["--screenshot", "a.png"]
    ended = run_here(command, "a.off", *output, "--timeout", "3", cwd=tmp_path)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith("grasp3d: a.off: took longer than 3 s (--timeout): ")
    assert "repairing the surface" in ended.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.off"]


@pytest.mark.slow
def test_the_unit_of_a_mesh_to_view_is_read_within_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def endless(*_: object, **__: object) -> None:
        busy("reading the mesh", 60.0)

    monkeypatch.setattr("grasp3d.mesh.mesh_sources.read_mesh", endless)
    written(tmp_path, "a.off", mesh_files.off_text())
    words = ("--max-opening", "5cm", "--screenshot", "a.png", "--timeout", "3")
    ended = run_here("view", "a.off", *words, cwd=tmp_path)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith("grasp3d: a.off: took longer than 3 s (--timeout): reading")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["label", "view"])
def test_a_time_limit_that_is_none(tmp_path: Path, command: str) -> None:
    for value in ("0", "-1", "inf", "nan"):
        ended = run_here(command, "a.off", "--timeout", value, cwd=tmp_path)
        assert ended.returncode == 2
        assert "timeout must be a finite time above 0 s" in ended.stderr + ended.stdout
    with pytest.raises(SettingError, match="above 0 s; got -1"):
        TimeLimited(timeout=-1.0)
