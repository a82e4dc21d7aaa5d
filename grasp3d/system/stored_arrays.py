"""Arrays and plain containers in pickles of NumPy's files; nothing in them is executed.

A pickle may call whatever it names. Of names only those are known here with which NumPy makes
arrays, types and scalars; functions of ours stand for them.
"""

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import HEADER_ERRORS
from grasp3d.system.names import reason_of


class RefusedError(ValueError):
    """A file is not read; the message says why."""


_MAKERS: dict[tuple[str, str], Any] = {
    ("numpy.core.multiarray", "_reconstruct"): lambda *_: np.empty(0, "b"),  # that gets its state
    ("numpy.core.multiarray", "scalar"): lambda kind, data: np.frombuffer(data, kind)[0].item(),
    ("numpy.core.numeric", "_frombuffer"): lambda data, kind, shape, order: np.frombuffer(
        data, kind
    ).reshape(shape, order=order),
    ("numpy", "ndarray"): None,  # only an argument of the first
    ("numpy", "dtype"): lambda name, *_: np.dtype(name, copy=True),  # never NumPy's own one
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
    return list(stored.ravel())


def array_in(value: object) -> npt.NDArray[Any]:
    """Numbers of an array, or of a list of them. Raises RefusedError."""
    if type(value) is list and all(isinstance(one, int | float) for one in value):
        value = np.array(value)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        raise RefusedError("has arrays of other values than numbers")
    return value
