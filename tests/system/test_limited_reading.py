"""Reading in a child process: answers, errors, limits of memory and time, crashes."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from tblib import pickling_support

from grasp3d.errors import FileUnreadError, MeshError
from grasp3d.system import limited_reading
from grasp3d.system.limited_reading import limited_reading as limited
from grasp3d.system.limited_reading import read_file

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")

FILE = Path("mug.stl")


def in_thread(read: Callable[[Path], object]) -> object:
    """What a thread that is not the main one reads with limits, or the error."""

    def work() -> object:
        assert threading.current_thread() is not threading.main_thread()
        with limited():
            return read_file(read, FILE)

    with ThreadPoolExecutor(1) as pool:
        return pool.submit(work).result()


def process(path: Path, *more: object) -> tuple[int, Path, tuple[object, ...]]:
    os.write(2, b"what a library prints")
    return os.getpid(), path, more


def nested(path: Path) -> bool:
    return read_file(process, path)[0] == os.getpid()


def refuse(path: Path) -> None:
    raise MeshError(f"{path}: is no mesh")


def fail(_: Path) -> None:
    raise LookupError("a bug")


def hang(_: Path) -> None:
    ctypes.CDLL(None).sleep(1000)  # in machine code, where no handler of Python runs


def crash(_: Path) -> None:
    ctypes.string_at(0)


def fill(_: Path) -> float:
    return float(np.ones(50_000_000).sum())


def big(_: Path) -> np.ndarray:
    return np.arange(2_000_000)


def test_python_reads_in_its_own_process() -> None:
    assert read_file(process, FILE, 1)[0] == os.getpid()
    with limited():
        assert read_file(process, FILE, 1)[0] != os.getpid()
    assert read_file(process, FILE, 1)[0] == os.getpid()


def test_a_child_process_answers_or_raises(capfd: pytest.CaptureFixture[str]) -> None:
    with limited():
        assert read_file(process, FILE, 2, "three")[1:] == (FILE, (2, "three"))
        assert read_file(big, FILE).sum() == big(FILE).sum()
        assert read_file(nested, FILE)
        with pytest.raises(MeshError, match=r"mug\.stl: is no mesh") as refused:
            read_file(refuse, FILE)
        assert not hasattr(refused.value, "__notes__")
        with pytest.raises(LookupError, match="a bug") as failed:
            read_file(fail, FILE)
    assert "in fail" in failed.value.__notes__[0]  # its traceback
    assert capfd.readouterr() == ("", "")


def because_of_xml(path: Path) -> None:
    try:
        etree.fromstring("<a>")
    except etree.XMLSyntaxError as error:  # it can be pickled, but not read again
        raise MeshError(f"{path.name}: is damaged") from error


def test_an_error_is_raised_whatever_its_cause() -> None:
    """Dask, once it is imported, lets exceptions be pickled with their causes."""
    pickling_support.install()
    with limited(), pytest.raises(MeshError, match=r"cup\.3mf: is damaged"):
        read_file(because_of_xml, Path("cup.3mf"))


def test_a_thread_reads_as_the_main_thread_does() -> None:
    assert in_thread(process)[0] != os.getpid()  # type: ignore[index]
    with pytest.raises(MeshError, match="is no mesh"):
        in_thread(refuse)


@pytest.mark.parametrize(
    ("read", "what"),
    [
        (crash, "Segmentation fault"),
        (lambda _: os.abort(), "Aborted"),
        (lambda _: os._exit(3), "exit code 3"),
    ],
)
def test_a_crash_is_one_sentence(read: Callable[[Path], object], what: str) -> None:
    with pytest.raises(FileUnreadError, match=rf"mug\.stl: reading it ended its process \({what}"):
        in_thread(read)


def test_a_read_that_hangs_in_machine_code_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limited_reading, "SECONDS", 0.3)
    started = time.monotonic()
    with pytest.raises(FileUnreadError, match=r"mug\.stl: reading it takes more than 0.3 s"):
        in_thread(hang)
    assert time.monotonic() - started < limited_reading.GRACE  # its own alarm has ended it


def test_a_process_without_an_alarm_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limited_reading, "SECONDS", 0.3)
    monkeypatch.setattr(limited_reading, "GRACE", 0.2)
    monkeypatch.setattr(signal, "setitimer", lambda *_: None)
    with pytest.raises(FileUnreadError, match=r"takes more than 0.3 s"):
        in_thread(hang)


def test_memory_is_limited_to_more_than_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = np.ones(60_000_000)  # more than the limit, but of the parent
    monkeypatch.setattr(limited_reading, "MEMORY", 3e8)
    assert kept.nbytes > limited_reading.MEMORY
    assert in_thread(process)
    with pytest.raises(FileUnreadError, match=r"takes more than 0\.3 GB of memory"):
        in_thread(fill)
    monkeypatch.setattr(limited_reading, "MEMORY", 1e9)
    assert in_thread(fill) == 50_000_000


def test_children_of_several_threads_do_not_wait_for_each_other() -> None:
    def one(read: Callable[[Path], object]) -> object:
        try:
            with limited():
                return read_file(read, FILE)
        except FileUnreadError as error:
            return error

    with ThreadPoolExecutor(8) as pool:
        hanging = pool.submit(one, hang)
        time.sleep(0.1)
        found = list(pool.map(one, [crash, *[process] * 20]))
        assert not hanging.done()
        for child in multiprocessing.active_children():
            child.kill()
    assert isinstance(found[0], FileUnreadError)
    assert len({answer[0] for answer in found[1:]}) == 20  # type: ignore[index]
