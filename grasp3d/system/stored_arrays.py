"""Arrays and plain containers in pickles of NumPy's files; nothing in them is executed.

A pickle may call whatever it names. Of names only those are known here with which NumPy makes
arrays, types and scalars; functions of ours stand for them.
"""

import io
import math
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import HEADER_ERRORS
from grasp3d.system.names import reason_of


class RefusedError(ValueError):
    """A file is not read; the message says why."""


_KIND = re.compile(r"[<>|=]?([fiu][1248]|f16|b1|[SU]\d{1,6}|O8?)")
"""Types of arrays that are read: numbers, texts, and what the pickle itself has made."""


class _Kind:
    """A type of NumPy in a pickle, of whose state only the order of bytes counts."""

    def __init__(self, name: object, *_: object) -> None:
        if not (isinstance(name, str) and _KIND.fullmatch(name)):
            raise RefusedError(f"has arrays of the type {ascii(name)[:20]}, which are not read")
        self.type = np.dtype(name)

    def __setstate__(self, state: Any) -> None:
        if state[1] in ("<", ">"):
            self.type = self.type.newbyteorder(state[1])


class _Array(np.ndarray):
    """An array whose values are as many as its shape says, and of its type."""

    def __setstate__(self, state: Any) -> None:
        _, shape, kind, is_fortran, values = state
        count = math.prod(shape) * (1 if kind.type.hasobject else kind.type.itemsize)
        expected = list if kind.type.hasobject else bytes
        if min(shape, default=0) < 0 or type(values) is not expected or len(values) != count:
            raise RefusedError("has an array that is damaged")
        fortran: Any = bool(is_fortran)
        super().__setstate__((1, tuple(map(int, shape)), kind.type, fortran, values))


def _numbers(values: Any, kind: Any, shape: Any = (), order: str = "C") -> Any:
    """Numbers of bytes; none are objects, which would be addresses."""
    if kind.type.hasobject:
        raise RefusedError("has objects where numbers are")
    return np.frombuffer(bytes(values), kind.type).reshape(
        shape, order="F" if order == "F" else "C"
    )


_KNOWN: dict[tuple[str, str], Callable[..., Any]] = {
    ("_codecs", "encode"): lambda text, *_: text.encode("latin-1"),
    ("builtins", "bytes"): lambda *_: b"",  # how none are written in old pickles
    ("numpy", "ndarray"): lambda *_: None,  # what the next one is to make
    ("numpy.core.multiarray", "_reconstruct"): lambda *_: np.empty(0).view(_Array),
    ("numpy.core.multiarray", "scalar"): lambda kind, values: _numbers(values, kind).item(),
    ("numpy.core.numeric", "_frombuffer"): _numbers,
    ("numpy", "dtype"): _Kind,
}
"""What stands for the functions and classes that a pickle may name: none of NumPy's, which believe
what a pickle says of memory."""


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """What stands for a name. Raises RefusedError."""
        module = module.replace("numpy._core", "numpy.core").replace("__builtin__", "builtins")
        if (module, name) not in _KNOWN:
            raise RefusedError(
                f"is a pickle that names {ascii(module[:40])[1:-1]}.{ascii(name[:40])[1:-1]}: "
                "only arrays and plain containers are read, and nothing is executed"
            )

        def made(*given: Any) -> Any:  # a pickle may change what it gets
            return _KNOWN[module, name](*given)

        return made


def stored_objects(path: Path) -> list[Any] | None:
    """The objects of an .npy file, one of them or a row; None: it is an array of numbers or text.

    Nothing is executed.

    Raises:
        RefusedError: The file is no such file, damaged, or has other objects.
        OSError: It cannot be read.
    """
    try:
        stream = io.BytesIO(path.read_bytes())
        np.lib.format.read_magic(stream)  # later versions are for long headers only
        if not np.lib.format.read_array_header_1_0(stream)[2].hasobject:
            return None
        stored = _Unpickler(stream).load()
    except RefusedError:
        raise
    except (*HEADER_ERRORS, pickle.PickleError, LookupError, AttributeError, SystemError) as error:
        raise RefusedError(f"is no .npy file, or damaged ({reason_of(error)})") from error
    if not isinstance(stored, np.ndarray) or stored.dtype != object:
        raise RefusedError("has no objects")
    return list(np.asarray(stored).ravel())


def array_in(value: object) -> npt.NDArray[Any]:
    """Numbers of an array, or of a list of them. Raises RefusedError."""
    if type(value) is list and all(isinstance(one, int | float) for one in value):
        value = np.array(value)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        raise RefusedError("has arrays of other values than numbers")
    return value
