"""Calls in child processes: results, failures, limits, and the end of all processes."""

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
from grasp3d.system.isolation import (
    CallFailedError,
    CallFailure,
    NeedsMemory,
    allowed_memory,
    call,
    call_pickled,
    describe_unexpected,
    end_idle,
    pickle_call,
)
from grasp3d.system.isolation.process import ProcessPool

posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def process() -> int:
    return os.getpid()


def crash() -> None:
    ctypes.string_at(0)


def killed(signum: int) -> None:
    os.kill(os.getpid(), signum)


def fill(gigabytes: float) -> float:
    """Allocate memory in small steps, and write to all of it."""
    kept = [np.ones(1_250_000) for _ in range(round(gigabytes * 100))]
    return sum(map(len, kept)) * 8e-9


def fill_for_a_while(gigabytes: float) -> float:
    """Keep the memory for several periods of the monitor, which must not miss it."""
    kept = np.ones(round(gigabytes * 1.25e8))
    time.sleep(1.0)
    return kept.nbytes * 1e-9


def leak(gigabytes: float) -> None:
    """Allocate memory and never free it."""
    vars(sys)["leak"] = np.ones(round(gigabytes * 1.25e8))


def request_too_much() -> None:
    np.ones(10**15)


def fill_in_descendant(gigabytes: float) -> None:
    """Allocate memory in another process, in a session of its own."""
    code = f"import numpy, time; a = numpy.ones(int({gigabytes} * 1.25e8)); time.sleep(60)"
    subprocess.run([sys.executable, "-c", code], check=False, start_new_session=True)


def start_and(then: str, path: str, *, alone: bool) -> None:
    """Start a process that sleeps, write the ids of both processes to a file, and crash or wait."""
    sleeper = subprocess.Popen(["sleep", "60"], start_new_session=alone)  # noqa: S607
    Path(path).write_text(f"{os.getpid()} {sleeper.pid} ", encoding="ascii")
    if then == "crash":
        os.abort()
    time.sleep(60.0)


def print_and_read() -> str:
    print("printed text", flush=True)  # noqa: T201
    os.system("echo more text")  # noqa: S605, S607
    sys.stdin.readline()
    return "answer"


def unpicklable() -> threading.Lock:
    return threading.Lock()


class NotUnpicklableError(Exception):
    """Pickles, but does not unpickle."""

    def __init__(self, one: str, two: str) -> None:
        super().__init__(one + two)


def failing(error: BaseException | None = None) -> None:
    if error is None:
        raise NotUnpicklableError("one", "two")
    raise error


def environment(*names: str) -> list[str | None]:
    return [os.environ.get(name) for name in names]


def has_ended(pid: int, within: float = 3.0) -> bool:
    end = time.monotonic() + within
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def test_a_call_returns_the_result_and_the_child_is_reused() -> None:
    first = call(process)
    assert first != os.getpid()
    assert call(process) == first
    assert call(sorted, [3, 1, 2]) == [1, 2, 3]
    assert call(lambda: first) == first  # pickled by value, like functions of a script
    end_idle()
    assert has_ended(first)
    assert call(process) != first


Case = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any], CallFailure, str]

FAILURES: dict[str, Case] = {
    "segmentation fault": (crash, (), {}, CallFailure.CRASHED, "crashed (segmentation fault)"),
    "abort": (os.abort, (), {}, CallFailure.CRASHED, "crashed (aborted)"),
    "exit": (
        os._exit, (3,), {}, CallFailure.CRASHED,
        "ended its process without a result (exit code 3)",
    ),
    "kill": (
        killed, (9,), {}, CallFailure.KILLED,
        "was killed from outside, most likely for lack of memory",
    ),
    "terminate": (killed, (15,), {}, CallFailure.KILLED, "was killed from outside (terminated)"),
    "time": (
        time.sleep, (60.0,), {"seconds": 0.3}, CallFailure.OUT_OF_TIME,
        "took longer than 0.3 s and was ended",
    ),
    "memory": (
        fill, (20.0,), {"memory": 0.5}, CallFailure.OUT_OF_MEMORY,
        "took more than 0.5 GB of memory and was ended",
    ),
    "memory of a descendant": (
        fill_in_descendant, (0.7,), {"memory": 0.6}, CallFailure.OUT_OF_MEMORY,
        "took more than 0.6 GB of memory and was ended",
    ),
    "more than available": (
        request_too_much, (), {}, CallFailure.OUT_OF_MEMORY,
        "requested more memory than is available and was ended",
    ),
    "far more than allowed": (
        bytearray, (8 * 10**9,), {"memory": 2.0}, CallFailure.OUT_OF_MEMORY,
        "requested more memory than is available and was ended",
    ),
    "cancelled": (
        time.sleep, (60.0,), {"cancelled": lambda: True}, CallFailure.CANCELLED, "was cancelled",
    ),
}  # fmt: skip


@pytest.mark.slow
@posix
@pytest.mark.parametrize("case", FAILURES)
def test_each_failure_has_its_kind_and_message_and_the_next_call_succeeds(case: str) -> None:
    function, arguments, limits, kind, message = FAILURES[case]
    before, started = call(process), time.monotonic()
    with pytest.raises(CallFailedError) as info:
        call_pickled(pickle_call(function, *arguments), **limits)
    assert (info.value.kind, str(info.value)) == (kind, message)
    assert time.monotonic() - started < 5.0
    assert has_ended(before)
    assert call(process) not in {before, os.getpid()}


@pytest.mark.slow
def test_a_call_within_its_limits_succeeds() -> None:
    limits = {"memory": 1.5, "seconds": 30.0}
    assert call(fill, 0.3, **limits) == pytest.approx(0.3)
    assert call(allowed_memory, **limits) == 1.5
    assert call(allowed_memory) is None
    assert allowed_memory() is None


def test_a_result_is_returned_without_delay() -> None:
    call(process)
    started = time.perf_counter()
    for _ in range(20):
        call(process)
    assert time.perf_counter() - started < 1.5  # less than one period of the monitor for each


def test_large_results_and_arguments_are_complete() -> None:
    data = np.random.default_rng(0).bytes(30_000_000)
    assert call(bytes.__add__, data, b"end") == data + b"end"


@pytest.mark.slow
def test_a_call_does_not_fail_because_of_memory_of_earlier_calls(tmp_path: Path) -> None:
    first = call(process, memory=1.0)
    call(leak, 0.5, memory=2.0)
    assert call(process, memory=2.0) == first
    # In a new child, where it fits:
    assert call(fill_for_a_while, 0.3, memory=0.7) == pytest.approx(0.3)
    assert has_ended(first)
    end_idle()
    for earlier_calls in range(2):
        attempts = tmp_path / str(earlier_calls)
        with pytest.raises(CallFailedError):
            call(count_and_fill, str(attempts), memory=0.5)
        assert len(attempts.read_text(encoding="ascii")) == 1 + earlier_calls
        call(process)


def count_and_fill(path: str) -> None:
    with Path(path).open("a", encoding="ascii") as stream:
        stream.write("x")
    fill(20.0)


def test_printed_text_is_not_part_of_the_answer_and_the_input_is_empty() -> None:
    assert call(print_and_read) == "answer"
    assert call(print_and_read) == "answer"


def test_exceptions_are_raised_in_the_parent() -> None:
    with pytest.raises(KeyError, match="missing") as info:
        call(failing, KeyError("missing"))
    assert "in failing" in info.value.__notes__[0]
    with pytest.raises(NeedsMemory, match="needs about 3 GB") as need:
        call(failing, NeedsMemory(3.0))
    assert need.value.gigabytes == 3.0
    with pytest.raises(TypeError, match="its result cannot be pickled"):
        call(unpicklable)
    with pytest.raises(RuntimeError, match="NotUnpicklableError: onetwo"):
        call(failing)
    with pytest.raises(RuntimeError, match="SystemExit: 3"):
        call(sys.exit, 3)
    assert describe_unexpected(ValueError("two\nlines")) == (
        "unexpected ValueError: two lines; please report this mesh"
    )


def test_the_child_has_the_working_folder_and_module_path_of_its_parent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "module_of_a_test.py").write_text("def answer():\n    return 42\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    import module_of_a_test  # type: ignore[import-not-found]

    assert call(module_of_a_test.answer) == 42
    assert call(os.getcwd) == str(tmp_path)
    assert call(environment, "NUMBA_NUM_THREADS", "OMP_NUM_THREADS") == ["1", "1"]


def test_a_folder_of_an_earlier_call_may_be_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    monkeypatch.chdir(first)
    assert call(os.getcwd) == str(first)
    monkeypatch.chdir(second)
    first.rmdir()
    assert call(os.getcwd) == str(second)


@pytest.mark.slow
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


@pytest.mark.slow
@posix
@pytest.mark.parametrize("then", ["crash", "wait"])
def test_processes_that_a_child_started_end_with_it(tmp_path: Path, then: str) -> None:
    with pytest.raises(CallFailedError):
        call(start_and_then, then, str(tmp_path / "pids"), seconds=0.5)
    for pid in (tmp_path / "pids").read_text(encoding="ascii").split():
        assert has_ended(int(pid))


def start_and_then(then: str, path: str) -> None:
    # After a crash, descendants in sessions of their own can no longer be found.
    start_and(then, path, alone=then == "wait")


PARENT = """
import os, signal, sys, threading, time
from pathlib import Path
from grasp3d.system.isolation import call
from tests.system.test_isolation import process, start_and_then
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
path = sys.argv[1]
threading.Thread(target=call, args=(start_and_then, "wait", path), daemon=True).start()
while not Path(path).exists() or len(Path(path).read_text().split()) < 2:
    time.sleep(0.02)
print("ready", flush=True)
time.sleep(60.0)
"""


@pytest.mark.slow
@posix
@pytest.mark.parametrize("signum", [signal.SIGKILL, signal.SIGINT])
def test_children_end_with_their_parent_during_a_call(tmp_path: Path, signum: int) -> None:
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
        assert has_ended(int(pid))


@posix
def test_ctrl_c_reaches_the_parent_only() -> None:
    assert call(os.getsid, 0) != os.getsid(0)


@pytest.mark.slow
def test_idle_children_end_after_their_idle_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp3d.system.isolation.process.IDLE", 0.2)
    monkeypatch.setattr("grasp3d.system.isolation.calls.pool", ProcessPool())
    first = call(process)
    assert has_ended(first)
    assert call(process) != first
    end_idle()


def test_a_call_fails_as_killed_if_no_process_can_be_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object, **__: object) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    end_idle()
    monkeypatch.setattr(subprocess, "Popen", full)
    with pytest.raises(CallFailedError, match="cannot be started") as info:
        call(process)
    assert info.value.kind is CallFailure.KILLED
