"""Pickles of arrays: the same values as NumPy's, of every protocol, and nothing is executed."""

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp3d.formats.dictionaries import RefusedError, array_in, stored_objects

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
    with pytest.raises(RefusedError, match=r"is no \.npy file"):
        stored_objects(tmp_path / "d.npy")
