import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import grasp3d
from grasp3d.isolation import (
    Loss,
    Lost,
    NeedsMemory,
    allowed_memory,
    call,
    calls,
    end_idle,
    unexpected,
)
from grasp3d.isolation.process import Pool

posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def process() -> int:
    return os.getpid()


def crash() -> None:
    ctypes.string_at(0)


def killed(signum: int) -> None:
    os.kill(os.getpid(), signum)


def fill(gigabytes: float) -> float:
    """Take memory in small steps, and touch all of it."""
    kept = [np.ones(1_250_000) for _ in range(round(gigabytes * 100))]
    return sum(map(len, kept)) * 8e-9


def hoard(gigabytes: float) -> None:
    """Take memory and never give it back."""
    vars(sys)["hoard"] = np.ones(round(gigabytes * 1.25e8))


def ask_for_too_much() -> None:
    np.ones(10**15)


def fill_below(gigabytes: float) -> None:
    """Let another process take memory, in a session of its own."""
    code = f"import numpy, time; a = numpy.ones(int({gigabytes} * 1.25e8)); time.sleep(60)"
    subprocess.run([sys.executable, "-c", code], check=False, start_new_session=True)


def start_and(then: str, path: str, *, alone: bool) -> None:
    """Start a process that lives long, write down its number, and crash or wait."""
    sleeper = subprocess.Popen(["sleep", "60"], start_new_session=alone)  # noqa: S607
    Path(path).write_text(f"{os.getpid()} {sleeper.pid} ", encoding="ascii")
    if then == "crash":
        os.abort()
    time.sleep(60.0)


def noise() -> str:
    print("this is no answer", flush=True)  # noqa: T201
    os.system("echo nor this")  # noqa: S605, S607
    sys.stdin.readline()
    return "answer"


def stubborn() -> threading.Lock:
    return threading.Lock()


class OddError(Exception):
    """Can be written as a pickle, but not read."""

    def __init__(self, one: str, two: str) -> None:
        super().__init__(one + two)


def failing(error: BaseException | None = None) -> None:
    if error is None:
        raise OddError("one", "two")
    raise error


def environment(*names: str) -> list[str | None]:
    return [os.environ.get(name) for name in names]


def gone(pid: int, within: float = 3.0) -> bool:
    end = time.monotonic() + within
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def test_a_call_is_what_the_function_gives_and_the_child_is_kept() -> None:
    first = call(process)
    assert first != os.getpid()
    assert call(process) == first
    assert call(sorted, [3, 1, 2]) == [1, 2, 3]
    assert call(lambda: first) == first  # by value, as those of a script
    end_idle()
    assert gone(first)
    assert call(process) != first


ENDS: dict[str, tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any], Loss, str]] = {
    "segmentation fault": (crash, (), {}, Loss.CRASHED, "crashed (segmentation fault)"),
    "abort": (os.abort, (), {}, Loss.CRASHED, "crashed (aborted)"),
    "exit": (os._exit, (3,), {}, Loss.CRASHED, "ended its process without an answer (exit code 3)"),
    "kill": (
        killed, (9,), {}, Loss.KILLED, "was killed from outside, most likely for want of memory",
    ),
    "terminate": (killed, (15,), {}, Loss.KILLED, "was killed from outside (terminated)"),
    "time": (
        time.sleep, (60.0,), {"seconds": 0.3}, Loss.OUT_OF_TIME,
        "took longer than 0.3 s and was ended",
    ),
    "memory": (
        fill, (20.0,), {"memory": 0.5}, Loss.OUT_OF_MEMORY,
        "took more than 0.5 GB of memory and was ended",
    ),
    "memory below": (
        fill_below, (0.7,), {"memory": 0.6}, Loss.OUT_OF_MEMORY,
        "took more than 0.6 GB of memory and was ended",
    ),
    "more than there is": (
        ask_for_too_much, (), {}, Loss.OUT_OF_MEMORY,
        "asked for more memory than there is and was ended",
    ),
    "far more than allowed": (
        bytearray, (8 * 10**9,), {"memory": 2.0}, Loss.OUT_OF_MEMORY,
        "asked for more memory than there is and was ended",
    ),
    "taken back": (
        time.sleep, (60.0,), {"cancelled": lambda: True}, Loss.CANCELLED, "was taken back",
    ),
}  # fmt: skip


@posix
@pytest.mark.parametrize("case", ENDS)
def test_each_end_is_told_as_what_it_is_and_the_next_call_is_well(case: str) -> None:
    function, arguments, limits, kind, told = ENDS[case]
    before, begun = call(process), time.monotonic()
    with pytest.raises(Lost) as info:
        call(function, *arguments, **limits)
    assert (info.value.kind, str(info.value)) == (kind, told)
    assert time.monotonic() - begun < 5.0
    assert gone(before)
    assert call(process) not in {before, os.getpid()}


def test_within_the_limits_nothing_happens() -> None:
    limits = {"memory": 1.5, "seconds": 30.0}
    assert call(fill, 0.3, **limits) == pytest.approx(0.3)
    assert call(allowed_memory, **limits) == 1.5
    assert call(allowed_memory) is None
    assert allowed_memory() is None


def test_a_result_is_taken_at_once() -> None:
    call(process)
    begun = time.perf_counter()
    for _ in range(20):
        call(process)
    assert time.perf_counter() - begun < 1.5  # less than one look at the limits for each


def test_large_results_and_arguments_come_whole() -> None:
    data = np.random.default_rng(0).bytes(30_000_000)
    assert call(bytes.__add__, data, b"end") == data + b"end"


def test_a_call_is_not_blamed_for_what_others_left(tmp_path: Path) -> None:
    first = call(process, memory=1.0)
    call(hoard, 0.5, memory=2.0)
    assert call(process, memory=2.0) == first
    assert call(fill, 0.3, memory=0.7) == pytest.approx(0.3)  # in a fresh one, where it fits
    assert gone(first)
    end_idle()
    for calls_before in range(2):
        tries = tmp_path / str(calls_before)
        with pytest.raises(Lost):
            call(count_and_fill, str(tries), memory=0.5)
        assert len(tries.read_text(encoding="ascii")) == 1 + calls_before
        call(process)


def count_and_fill(path: str) -> None:
    with Path(path).open("a", encoding="ascii") as stream:
        stream.write("x")
    fill(20.0)


def test_what_is_printed_is_no_answer_and_nothing_can_be_read() -> None:
    assert call(noise) == "answer"
    assert call(noise) == "answer"


def test_exceptions_come_back_as_they_are() -> None:
    with pytest.raises(KeyError, match="missing") as info:
        call(failing, KeyError("missing"))
    assert "in failing" in info.value.__notes__[0]
    with pytest.raises(NeedsMemory, match="needs about 3 GB") as need:
        call(failing, NeedsMemory(3.0))
    assert need.value.gigabytes == 3.0
    with pytest.raises(TypeError, match="its result cannot be pickled"):
        call(stubborn)
    with pytest.raises(RuntimeError, match="OddError: onetwo"):
        call(failing)
    with pytest.raises(RuntimeError, match="SystemExit: 3"):
        call(sys.exit, 3)
    assert unexpected(ValueError("two\nlines")) == (
        "unexpected ValueError: two lines; please report this mesh"
    )


def test_the_child_works_where_this_process_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "module_of_a_test.py").write_text("def answer():\n    return 42\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    import module_of_a_test  # type: ignore[import-not-found]

    assert call(module_of_a_test.answer) == 42
    assert call(os.getcwd) == str(tmp_path)
    assert call(environment, "NUMBA_NUM_THREADS", "OMP_NUM_THREADS") == ["1", "1"]


@posix
def test_calls_of_several_threads_have_a_child_each() -> None:
    found: list[int] = []

    def work() -> None:
        call(time.sleep, 0.2)
        found.append(call(process))
        call(time.sleep, 0.2)

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(found)) == 3


@posix
@pytest.mark.parametrize("then", ["crash", "wait"])
def test_what_a_child_started_ends_with_it(tmp_path: Path, then: str) -> None:
    with pytest.raises(Lost):
        call(start_and_then, then, str(tmp_path / "pids"), seconds=0.5)
    for pid in (tmp_path / "pids").read_text(encoding="ascii").split():
        assert gone(int(pid))


def start_and_then(then: str, path: str) -> None:
    # A crash leaves nobody to ask for processes in sessions of their own.
    start_and(then, path, alone=then == "wait")


PARENT = """
import os, sys, threading, time
from pathlib import Path
from grasp3d.isolation import call
from tests.test_isolation import process, start_and_then
path = sys.argv[1]
threading.Thread(target=call, args=(start_and_then, "wait", path), daemon=True).start()
while not Path(path).exists() or len(Path(path).read_text().split()) < 2:
    time.sleep(0.02)
print("ready", flush=True)
time.sleep(60.0)
"""


@posix
@pytest.mark.parametrize("signum", [signal.SIGKILL, signal.SIGINT])
def test_children_amid_a_call_end_with_their_parent(tmp_path: Path, signum: int) -> None:
    root = Path(grasp3d.__file__).parents[1]
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(tmp_path / "pids")],
        cwd=root,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    with parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"ready\n"
        parent.send_signal(signum)
        parent.wait(5.0)
    for pid in (tmp_path / "pids").read_text(encoding="ascii").split():
        assert gone(int(pid))


@posix
def test_interrupts_of_the_terminal_are_for_the_parent_alone() -> None:
    assert call(os.getsid, 0) != os.getsid(0)


def test_idle_children_end_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    pool = Pool("grasp3d.isolation.child", {}, keep=0.2)
    monkeypatch.setattr(calls, "_pool", pool)
    first = call(process)
    assert gone(first)
    assert call(process) != first
    pool.end_idle()


def test_a_machine_that_can_start_no_process_is_no_fault_of_the_call(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object, **__: object) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    end_idle()
    monkeypatch.setattr(subprocess, "Popen", full)
    with pytest.raises(Lost, match="could not be given a process") as info:
        call(process)
    assert info.value.kind is Loss.KILLED
