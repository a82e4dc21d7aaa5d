"""Jobs in other processes: results, failures, limits, and the end of all processes."""

import ctypes
import os
import pickle
import shutil
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
from grasp3d.batch.limits import CallFailedError, CallFailure, NeedsMemory, allowed_memory
from grasp3d.batch.worker import call_pickled, end_idle, pickle_call

posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def call(function: Callable[..., Any], *arguments: object, **limits: Any) -> Any:
    """What a function returns in another process."""
    data = call_pickled(pickle_call(function, *arguments), **limits)
    return pickle.loads(data)  # noqa: S301, from a process of ours


def process() -> int:
    return os.getpid()


def crash() -> None:
    ctypes.string_at(0)


def hang() -> None:
    ctypes.PyDLL(None).sleep(60)  # in machine code, while no other thread of Python runs


def killed(signum: int) -> None:
    os.kill(os.getpid(), signum)


def fill(gigabytes: float) -> float:
    """Allocate memory in small steps, and write to all of it."""
    kept = [np.ones(1_250_000) for _ in range(round(gigabytes * 100))]
    return sum(map(len, kept)) * 8e-9


def start_and_wait(path: str) -> None:
    """Start a process that sleeps, write the ids of both processes to a file, and wait."""
    sleeper = subprocess.Popen(["sleep", "60"])  # noqa: S607
    Path(path).write_text(f"{os.getpid()} {sleeper.pid} ", encoding="ascii")
    time.sleep(60.0)


def print_and_read() -> str:
    print("printed text", flush=True)  # noqa: T201
    os.system("echo more text")  # noqa: S605, S607
    sys.stdin.readline()
    return "answer"


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


def test_a_call_returns_the_result_and_the_process_is_used_again() -> None:
    first = call(process)
    assert first != os.getpid()
    assert call(process) == first
    assert call(lambda: first) == first  # pickled by value, like functions of a script
    data = np.random.default_rng(0).bytes(30_000_000)
    assert call(bytes.__add__, data, b"end") == data + b"end"
    end_idle()
    assert has_ended(first)
    assert call(process) != first


Case = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any], CallFailure, str]

FAILURES: dict[str, Case] = {
    "segmentation fault": (crash, (), {}, CallFailure.CRASHED, "crashed (segmentation fault)"),
    "kill": (
        killed, (9,), {}, CallFailure.KILLED,
        "was killed from outside, most likely for lack of memory",
    ),
    "time": (
        hang, (), {"seconds": 0.3}, CallFailure.OUT_OF_TIME, "took longer than 0.3 s and was ended",
    ),
    "memory": (
        fill, (20.0,), {"memory": 0.5}, CallFailure.OUT_OF_MEMORY,
        "took more than 0.5 GB of memory and was ended",
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


def test_printed_text_is_not_part_of_the_answer_and_the_input_is_empty() -> None:
    assert call(print_and_read) == "answer"


def test_exceptions_are_raised_in_this_process() -> None:
    with pytest.raises(KeyError, match="missing") as info:
        call(failing, KeyError("missing"))
    assert "in failing" in info.value.__notes__[0]
    with pytest.raises(NeedsMemory, match="needs about 3 GB") as need:
        call(failing, NeedsMemory(3.0))
    assert need.value.gigabytes == 3.0
    with pytest.raises(TypeError, match="cannot pickle"):
        call(threading.Lock)
    with pytest.raises(RuntimeError, match="NotUnpicklableError: onetwo"):
        call(failing)
    with pytest.raises(RuntimeError, match="SystemExit: 3"):
        call(sys.exit, 3)


def test_the_process_has_the_working_folder_and_module_path_of_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    (first / "module_of_a_test.py").write_text("def answer():\n    return 42\n")
    monkeypatch.syspath_prepend(first)
    monkeypatch.chdir(first)
    import module_of_a_test  # type: ignore[import-not-found]

    assert call(module_of_a_test.answer) == 42
    assert call(os.getcwd) == str(first)
    assert call(environment, "NUMBA_NUM_THREADS", "OMP_NUM_THREADS") == ["1", "1"]
    monkeypatch.chdir(second)
    shutil.rmtree(first)
    assert call(os.getcwd) == str(second)


@posix
def test_calls_of_several_threads_have_a_process_each() -> None:
    barrier, found = threading.Barrier(3), list[int]()

    def work() -> None:
        barrier.wait()
        call(time.sleep, 1.0)
        found.append(call(os.getsid, 0))

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert os.getsid(0) not in found  # Ctrl-C reaches this process only


PARENT = """
import signal, sys, threading, time
from pathlib import Path
from grasp3d.batch.worker import call_pickled, pickle_call
from tests.batch.test_worker import start_and_wait
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
path = sys.argv[1]
work = pickle_call(start_and_wait, path)
threading.Thread(target=call_pickled, args=[work], daemon=True).start()
while not Path(path).exists() or len(Path(path).read_text().split()) < 2:
    time.sleep(0.02)
print("ready", flush=True)
time.sleep(60.0)
"""


@pytest.mark.slow
@posix
@pytest.mark.parametrize("signum", [signal.SIGKILL, signal.SIGINT])
def test_processes_end_with_this_one(tmp_path: Path, signum: int) -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(tmp_path / "pids")],
        cwd=Path(grasp3d.__file__).parents[1],
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


@pytest.mark.slow
@posix
def test_what_a_job_started_ends_with_it(tmp_path: Path) -> None:
    with pytest.raises(CallFailedError):
        call(start_and_wait, str(tmp_path / "pids"), seconds=1.0)
    for pid in (tmp_path / "pids").read_text(encoding="ascii").split():
        assert has_ended(int(pid))
