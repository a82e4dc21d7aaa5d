"""Pickles of arrays: the same values as NumPy's, of every protocol, and nothing is executed."""

import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree
from tblib import pickling_support

from grasp3d.errors import FileUnreadError, MeshError
from grasp3d.formats.dictionaries import RefusedError, array_in, stored_objects
from grasp3d.system import limited_reading
from grasp3d.system.limited_reading import limited_reading as limited
from grasp3d.system.limited_reading import read_file

ARRAYS = (
    np.arange(24.0).reshape(2, 3, 4),
    np.arange(6, dtype=">i2").reshape(2, 3).T,
    np.asfortranarray(np.arange(6.0, dtype=np.float16).reshape(2, 3)),
    np.array([True, False]),
    np.array([], dtype=np.float32),
    np.array(7, dtype=np.uint64),
    np.arange(10)[::3],
)
PLAIN = {-1: [1, 2.5, None, True], "a": (1, (2, (3,))), 2**70: b"abc", "s": [], 1.5: "é\n"}


def file_of(folder: Path, content: bytes) -> Path:
    """An .npy file of objects with another pickle."""
    path = folder / "a.npy"
    np.save(path, np.array([None], dtype=object))
    path.write_bytes(path.read_bytes()[:128] + content)
    return path


def unpickled(folder: Path, value: object, protocol: int = 4) -> Any:
    array = np.empty(1, dtype=object)
    array[0] = value
    (found,) = stored_objects(file_of(folder, pickle.dumps(array, protocol))) or []
    return found


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_values_are_those_that_numpy_stored(tmp_path: Path, protocol: int) -> None:
    for array in ARRAYS:
        found = array_in(unpickled(tmp_path, {"array": array}, protocol)["array"])
        assert found.dtype.newbyteorder("=") == array.dtype.newbyteorder("=")
        np.testing.assert_array_equal(found, array)
    assert unpickled(tmp_path, PLAIN, protocol) == PLAIN
    numbers = [np.float32(0.5), np.int64(-3), np.array([True])[0], np.float64(np.inf)]
    assert unpickled(tmp_path, numbers, protocol) == numbers
    text = unpickled(tmp_path, [np.str_("mug"), np.array([["a", "bc"]])], protocol)
    assert text[0] == "mug"
    assert text[1].tolist() == [["a", "bc"]]
    of_objects = unpickled(tmp_path, np.array([{1: np.eye(2)}, None]), protocol)
    (first, second) = of_objects
    np.testing.assert_array_equal(array_in(first[1]), np.eye(2))
    assert second is None


class Reduced:
    """What is made by a function of NumPy, with arguments and a state that NumPy would believe."""

    def __init__(self, *how: Any) -> None:
        self.how = how

    def __reduce__(self) -> Any:
        return self.how


ADDRESS = b"A" * 8
"""Of no object."""
OBJECTS = Reduced(np.dtype, ("O8", False, True), (3, "|", None, None, None, -1, -1, 0))
SCALAR, RECONSTRUCT = np.float64(1.0).__reduce__()[0], np.eye(2).__reduce__()[0]


@pytest.mark.parametrize(
    "value",
    [
        Reduced(SCALAR, (OBJECTS, ADDRESS)),
        Reduced(RECONSTRUCT, (np.ndarray, (0,), b"b"), (1, (1,), OBJECTS, False, ADDRESS)),
        Reduced(RECONSTRUCT, (np.ndarray, (0,), b"b"), (1, (3,), np.dtype("f8"), False, ADDRESS)),
        Reduced(RECONSTRUCT, (np.ndarray, (0,), b"b"), (1, (-1,), np.dtype("f8"), False, b"")),
        Reduced(SCALAR, (Reduced(np.dtype, ("V8", False, True)), ADDRESS)),
    ],
)
def test_no_address_and_no_length_of_a_file_is_believed(tmp_path: Path, value: object) -> None:
    with pytest.raises(RefusedError):
        unpickled(tmp_path, [value])


MALICIOUS = {
    "function": pickle.dumps(Reduced(os.mkdir, ("executed",))),
    "old function": pickle.dumps(Reduced(os.mkdir, ("executed",)), 0),
    "eval": pickle.dumps(Reduced(eval, ("__import__('os').mkdir('executed')",))),
    "numpy's loader": pickle.dumps(np.load),
    "numpy's memory": b"cnumpy\nmemmap\n(S'executed'\nS'i1'\nS'w+'\nI0\n(I4\nttR.",
    "dotted": b"\x80\x04\x8c\x05numpy\x8c\x0ddtype.__new__\x93.",
    "instance": b"(S'executed'\nios\nmkdir\n.",
    "extension": b"\x80\x04\x82\x01.",
    "persistent": b"Pexecuted\n.",
    "bytes array": pickle.dumps(np.array([b"a"])),
    "dates": pickle.dumps(np.array(1, dtype="M8[s]")),
    "record": pickle.dumps(np.zeros(1, dtype=[("a", "f8")])),
    "cut": pickle.dumps(np.zeros(3))[:-20],
    "empty": b"",
    "no pickle": b"garbage",
    "numbers": pickle.dumps(np.zeros(3)),
    "size": pickle.dumps(np.zeros(3)).replace(b"K\x03\x85", b"K\x04\x85"),
    "long text": b"\x80\x04\x8d\xff\xff\xff\xff\xff\xff\xff\x7fa.",
}  # fmt: skip


@pytest.mark.parametrize("name", list(MALICIOUS))
def test_nothing_else_is_read_or_executed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = file_of(tmp_path, MALICIOUS[name])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RefusedError) as error:
        stored_objects(path)
    assert "\n" not in str(error.value)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_numbers_are_arrays_or_flat_lists() -> None:
    np.testing.assert_array_equal(array_in([1, 2.5, True]), [1.0, 2.5, 1.0])
    nested: Any = [1.0, 2.0]
    for _ in range(40):
        nested = [nested, nested]
    for other in (nested, [[1.0]], (1.0, 2.0), ["1"], [None], [2**70], {1: 2}, 1.0, RefusedError):
        with pytest.raises(RefusedError, match="other values than numbers"):
            array_in(other)


def test_objects_of_a_file_are_read_and_numbers_are_left_to_numpy(tmp_path: Path) -> None:
    np.save(tmp_path / "b.npy", np.array([{"one": 1}, {"one": 2}], dtype=object))
    assert stored_objects(tmp_path / "b.npy") == [{"one": 1}, {"one": 2}]
    np.save(tmp_path / "c.npy", np.eye(3))
    assert stored_objects(tmp_path / "c.npy") is None
    (tmp_path / "d.npy").write_bytes(b"\x93NUMPY\x01\x00v\x00garbage")
    with pytest.raises(RefusedError, match=r"not a \.npy file"):
        stored_objects(tmp_path / "d.npy")


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
