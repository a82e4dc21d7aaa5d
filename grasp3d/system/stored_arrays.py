"""Arrays and plain containers in pickles of NumPy's files; nothing in them is executed.

A pickle may call whatever it names. Of names only those are known here with which NumPy makes
arrays, types and scalars; they stand for the classes below, which make an array of the bytes that
are there.
"""

import io
import pickle
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import HEADER_ERRORS
from grasp3d.system.names import reason_of

_KINDS = re.compile(r"b1|[iu][1248]|f[248]|U[1-9]\d{0,5}|O8?")
"""Types of arrays: numbers, texts and objects."""


class RefusedError(ValueError):
    """A file is not read; the message says why."""


class StoredArray:
    """An array of a pickle: its values, which are a list if they are objects."""

    def __init__(self, *_: object) -> None:
        self.values: npt.NDArray[Any] | list[Any] = []

    def __setstate__(self, state: Any) -> None:
        _, shape, kind, by_column, content = state
        if kind.name.startswith("O"):
            self.values = list(content)
        else:
            data = content.encode("latin-1") if isinstance(content, str) else content
            array = np.frombuffer(data, kind.order + kind.name)
            self.values = array.reshape(shape, order="F" if by_column else "C")


class _Kind:
    """A type of arrays."""

    def __init__(self, name: str, *_: object) -> None:
        if not _KINDS.fullmatch(name):
            raise RefusedError(f"has arrays of the type {name[:40]!a}, which are not read")
        self.name, self.order = name, "<"

    def __setstate__(self, state: Any) -> None:
        self.order = ">" if state[1] == ">" else "<"


def _of_buffer(content: Any, kind: _Kind, shape: Any, order: str) -> StoredArray:
    made = StoredArray()
    made.__setstate__((1, shape, kind, order == "F", content))
    return made


def _scalar(kind: _Kind, content: Any) -> Any:
    return _of_buffer(content, kind, (), "C").values.item()  # type: ignore[union-attr]


_MAKERS: Mapping[tuple[str, str], Callable[..., Any]] = {
    ("numpy.core.multiarray", "_reconstruct"): StoredArray,
    ("numpy.core.multiarray", "scalar"): _scalar,
    ("numpy.core.numeric", "_frombuffer"): _of_buffer,
    ("numpy", "ndarray"): StoredArray,
    ("numpy", "dtype"): _Kind,
    ("_codecs", "encode"): lambda text, *_: text.encode("latin-1"),
    ("builtins", "bytes"): lambda *_: b"",  # how none are written in old pickles
}
"""What stands for the functions and classes that a pickle may name."""


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """What stands for a name. Raises RefusedError."""
        module = module.replace("numpy._core", "numpy.core").replace("__builtin__", "builtins")
        if (module, name) not in _MAKERS:
            raise RefusedError(
                f"is a pickle that names {ascii(module[:40])[1:-1]}.{ascii(name[:40])[1:-1]}: "
                "only arrays and plain containers are read, and nothing is executed"
            )
        return _MAKERS[module, name]


def stored_objects(path: Path) -> list[Any] | None:
    """The objects of an .npy file, one of them or a row; None: it is an array of numbers or text.

    Arrays in it are `StoredArray`. Nothing is executed.

    Raises:
        RefusedError: The file is no such file, damaged, or has other objects.
        OSError: It cannot be read.
    """
    data = path.read_bytes()
    try:
        stream = io.BytesIO(data)
        version = np.lib.format.read_magic(stream)
        read_header = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        if not read_header(stream)[2].hasobject:
            return None
        stored = _Unpickler(stream).load()
    except RefusedError:
        raise
    except (*HEADER_ERRORS, pickle.UnpicklingError, LookupError, AttributeError) as error:
        raise RefusedError(f"is no .npy file, or damaged ({reason_of(error)})") from error
    values = stored.values if isinstance(stored, StoredArray) else None
    if not isinstance(values, list):
        raise RefusedError("has no objects")
    return values


def array_in(value: object) -> npt.NDArray[Any]:
    """Numbers of an array, or of a list of them. Raises RefusedError."""
    stored = value.values if isinstance(value, StoredArray) else value
    if type(stored) is list and all(type(one) in (int, float, bool) for one in stored):
        stored = np.array(stored)
    if not isinstance(stored, np.ndarray) or stored.dtype.kind not in "fiub":
        raise RefusedError("has arrays of other values than numbers")
    return stored
