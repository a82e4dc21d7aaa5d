"""Pickles of arrays: the same values as NumPy's, of every protocol, and nothing is executed."""

import os
import pickle
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp3d.system import stored_arrays
from grasp3d.system.stored_arrays import (
    Archive,
    RefusedError,
    StoredArray,
    array_in,
    stored_objects,
    unpickled,
)

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


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_values_are_those_that_numpy_stored(protocol: int) -> None:
    for array in ARRAYS:
        found = array_in(unpickled(pickle.dumps({"array": array}, protocol))["array"])
        assert found.dtype.newbyteorder("=") == array.dtype.newbyteorder("=")
        np.testing.assert_array_equal(found, array)
    assert unpickled(pickle.dumps(PLAIN, protocol)) == PLAIN
    numbers = [np.float32(0.5), np.int64(-3), np.array([True])[0], np.float64(np.inf)]
    assert unpickled(pickle.dumps(numbers, protocol)) == numbers
    text = unpickled(pickle.dumps([np.str_("mug"), np.array([["a", "bc"]])], protocol))
    assert text[0] == "mug"
    assert text[1].values.tolist() == [["a", "bc"]]
    of_objects = unpickled(pickle.dumps(np.array([{1: np.eye(2)}, None]), protocol))
    assert isinstance(of_objects, StoredArray)
    (first, second) = of_objects.values
    np.testing.assert_array_equal(array_in(first[1]), np.eye(2))
    assert second is None


class Executes:
    """What calls a function when it is unpickled in the usual way."""

    def __init__(self, *call: Any) -> None:
        self.call = call

    def __reduce__(self) -> tuple[Any, ...]:
        return self.call[0], self.call[1:]


MALICIOUS = {
    "function": pickle.dumps(Executes(os.mkdir, "executed")),
    "old function": pickle.dumps(Executes(os.mkdir, "executed"), 0),
    "eval": pickle.dumps(Executes(eval, "__import__('os').mkdir('executed')")),
    "getattr": pickle.dumps([getattr]),
    "numpy's loader": pickle.dumps(np.load),
    "numpy's memory": b"cnumpy\nmemmap\n(S'executed'\nS'i1'\nS'w+'\nI0\n(I4\nttR.",
    "dotted": b"\x80\x04\x8c\x05numpy\x8c\x0ddtype.__new__\x93.",
    "of a dtype": b"\x80\x04\x8c\x05numpy\x8c\x0endarray.tofile\x93.",
    "instance": b"(S'executed'\nios\nmkdir\n.",
    "object": b"(cos\nmkdir\nS'executed'\no.",
    "extension": b"\x80\x04\x82\x01.",
    "persistent": b"Pexecuted\n.",
    "new object": b"\x80\x04cnumpy\nndarray\n)\x81.",
    "buffer": b"\x80\x05\x97.",
    "class changed": b"\x80\x02cnumpy\ndtype\n}X\x05\x00\x00\x00_makeK\x01sb0.",
    "bytes array": pickle.dumps(np.array([b"a"])),
    "dates": pickle.dumps(np.array(1, dtype="M8[s]")),
    "record": pickle.dumps(np.zeros(1, dtype=[("a", "f8")])),
    "cut": pickle.dumps(np.zeros(3))[:-20],
    "empty": b"",
    "no pickle": b"garbage",
    "set": pickle.dumps({1}),
    "old set": pickle.dumps(frozenset({1}), 0),
    "no memo": b"\x80\x04h\x05.",
    "many": b"\x80\x04" + b"]" * 100_005 + b".",
    "stack": b"0.",
    "long text": b"\x80\x04\x8d\xff\xff\xff\xff\xff\xff\xff\x7fa.",
    "size": pickle.dumps(np.zeros(3)).replace(b"K\x03\x85", b"K\x04\x85"),
    "negative": pickle.dumps(np.zeros(3), 2).replace(b"K\x03\x85", b"J\xff\xff\xff\xff\x85"),
    "unhashable": b"\x80\x04}]K\x01s.",
}  # fmt: skip


@pytest.mark.parametrize("name", list(MALICIOUS))
def test_nothing_else_is_read_or_executed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stored_arrays, "MOST_STEPS", 100_000)
    started = time.perf_counter()
    with pytest.raises(RefusedError) as error:
        unpickled(MALICIOUS[name])
    assert "\n" not in str(error.value)
    assert time.perf_counter() - started < 10.0
    assert not list(tmp_path.iterdir())


NESTED = b")q\x05" + b"h\x05\x86q\x05" * 40
"""A tuple of the tuple before, twice, and so on: what looks at all of its values never ends."""

KIND = b"cnumpy\ndtype\nX\x02\x00\x00\x00u1\x85R"
BUFFER = b"cnumpy.core.numeric\n_frombuffer\n"
LONG_TEXT = b"\x80\x02(X\x00\x00\x10\x00" + b"a" * 2**20 + b"q\x00"
BOMBS = {
    "key": (b"\x80\x02}" + NESTED + b"K\x01s.", "other keys"),
    "keys": (b"\x80\x02(" + NESTED + b"K\x01d.", "other keys"),
    "member": (b"\x80\x04\x8f(" + NESTED + b"\x90.", "the step EMPTY_SET"),
    "type": (b"\x80\x02cnumpy\ndtype\n" + NESTED + b"\x85R.", "of the type tuple"),
    "shape": (
        b"\x80\x02" + BUFFER + b"(C\x01a" + KIND + NESTED + b"C\x01CtR.", "type or a shape",
    ),
    "name": (b"\x80\x04" + NESTED + b"\x8c\x01a\x93.", "name that is no text"),
    "arguments": (
        b"\x80\x02cnumpy\nndarray\n(" + b"K\x01" * 1000 + b"tR.", "without a type or a shape",
    ),
    "axes": (
        b"\x80\x02" + BUFFER + b"(C\x01a" + KIND + b"(" + b"K\x01" * 1000 + b"tC\x01CtR.",
        "without a type or a shape",
    ),
    "bytes": (
        LONG_TEXT + b"c_codecs\nencode\nh\x00X\x06\x00\x00\x00latin1\x86R" * 1500 + b"l.",
        "more texts of bytes",
    ),
    "arrays": (
        LONG_TEXT + (BUFFER + b"(h\x00" + KIND + b"J\x00\x00\x10\x00\x85C\x01CtR") * 1500 + b"l.",
        "more texts of bytes",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", list(BOMBS))
def test_short_pickles_take_no_long_time_or_much_memory(name: str) -> None:
    content, message = BOMBS[name]
    started = time.perf_counter()
    with pytest.raises(RefusedError, match=message):
        unpickled(content)
    assert time.perf_counter() - started < 10.0


def test_places_in_memory_are_no_sizes() -> None:
    assert unpickled(b"\x80\x04K\x01r\xff\xff\xff\x7f.") == 1
    assert unpickled(b"K\x01p1000000000000\n.") == 1


def test_numbers_are_arrays_or_flat_lists() -> None:
    np.testing.assert_array_equal(array_in([1, 2.5, True]), [1.0, 2.5, 1.0])
    nested: Any = [1.0, 2.0]
    for _ in range(40):
        nested = [nested, nested]
    for other in (nested, [[1.0]], (1.0, 2.0), ["1"], [None], [2**70], {1: 2}, 1.0, StoredArray):
        with pytest.raises(RefusedError, match="other values than numbers"):
            array_in(other)


def test_a_value_that_is_referred_to_often_is_one_value() -> None:
    value: list[Any] = []
    for _ in range(100):
        value = [value, value]
    found = unpickled(pickle.dumps(value))
    assert found[0] is found[1]


def test_arrays_of_an_archive_are_read_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    array = np.arange(70.0, dtype=np.float32).reshape(10, 7)
    np.savez_compressed(tmp_path / "a.npz", array=array, one=np.array(1.0))
    archive = Archive(tmp_path / "a.npz")
    assert archive.names == {"array", "one"}
    np.testing.assert_array_equal(archive.values("array"), array)
    with pytest.raises(RefusedError, match="array other is missing"):
        archive.values("other")
    monkeypatch.setattr(stored_arrays, "LARGEST_ARRAY", 200)
    with pytest.raises(RefusedError, match="the array array has"):
        archive.values("array")


def test_objects_of_a_file_are_read_and_numbers_are_left_to_numpy(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", {"one": np.eye(2), "name": "mug"})  # type: ignore[arg-type]
    (found,) = stored_objects(tmp_path / "a.npy") or []
    np.testing.assert_array_equal(array_in(found["one"]), np.eye(2))
    np.save(tmp_path / "b.npy", np.array([{"one": 1}, {"one": 2}], dtype=object))
    assert stored_objects(tmp_path / "b.npy") == [{"one": 1}, {"one": 2}]
    np.save(tmp_path / "c.npy", np.eye(3))
    assert stored_objects(tmp_path / "c.npy") is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is no .npy file"),
        (b"\x93NUMPY\x01\x00v\x00garbage", "is no .npy file"),
        (MALICIOUS["function"], "is a pickle that names posix.mkdir"),
        (pickle.dumps({"a": 1}), "has no objects"),
        (pickle.dumps(np.zeros(3)), "has no objects"),
    ],
)
def test_files_of_objects_that_are_none_are_refused(
    tmp_path: Path, content: bytes, message: str
) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.array([None], dtype=object))
    head = path.read_bytes()[:128]
    path.write_bytes(head + content if content[:2] == b"\x80\x04" else content)
    with pytest.raises(RefusedError, match=message):
        stored_objects(path)


def test_other_compressions_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("a.npy", b"")
    with pytest.raises(RefusedError, match="compressed in an unknown way"):
        Archive(tmp_path / "a.npz").values("a")
