"""Arrays in NumPy's files, whose sizes are checked before memory is allocated.

NumPy stores arrays of objects as pickles, which can call any function. Here nothing is executed:
the steps of a pickle are taken one by one, those that make numbers, texts, lists and dictionaries,
and of what is named only what NumPy's arrays, types and scalars are made with. These stand for the
few lines below, which make an array of the bytes that are there, once its shape is checked. What is
made is no larger than a multiple of the pickle. Keys of dictionaries may be chosen so that hashing
and comparing them takes long: a time limit is up to the caller.
"""

import io
import math
import pickletools
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import HEADER_ERRORS
from grasp3d.system.documents import MEGABYTE
from grasp3d.system.names import reason_of

MOST_STEPS = 1_000_000
"""Most steps of a pickle, each of which makes at most one value."""

_KINDS = re.compile(r"b1|[iu][1248]|f[248]|U[1-9]\d{0,5}|O8?")
"""Types of arrays: numbers, texts and objects."""

MOST_ARGUMENTS, MOST_AXES = 9, 32
"""Most values that an array is made with, of a shape with so many axes."""

_KEYS = str, int, float, bool, bytes
"""Types of keys, which are hashed without looking at other values."""


class RefusedError(ValueError):
    """A file is not read; the message says why."""


class StoredArray:
    """An array of a pickle: its values, which are a list if they are objects."""

    def __init__(self) -> None:
        self.values: npt.NDArray[Any] | list[Any] = []


class _Kind:
    """A type of arrays."""

    def __init__(self, name: object) -> None:
        if type(name) is not str or not _KINDS.fullmatch(name):
            what = ascii(name[:40]) if type(name) is str else type(name).__name__
            raise RefusedError(f"has arrays of the type {what}, which are not read")
        self.name, self.order = name, "<"


class _Stack:
    """What the steps of a pickle have made so far."""

    def __init__(self, size: int) -> None:
        self.values: list[Any] = []
        self._outer: list[list[Any]] = []
        self._memo: dict[int, Any] = {}
        self._encoded, self._size = 0, size

    def push(self, value: object) -> None:
        self.values.append(value)

    def take(self, count: int) -> list[Any]:
        """The last values, of which there must be as many."""
        if len(self.values) < count:
            raise RefusedError("has a damaged pickle (too few values)")
        taken = self.values[len(self.values) - count :]
        del self.values[len(self.values) - count :]
        return taken

    def mark(self) -> None:
        self._outer.append(self.values)
        self.values = []

    def marked(self) -> list[Any]:
        """The values since the last mark."""
        marked, self.values = self.values, self._outer.pop()
        return marked

    def remember(self, index: int | None) -> None:
        self._memo[len(self._memo) if index is None else index] = self.values[-1]

    def remembered(self, index: int) -> None:
        self.push(self._memo[index])

    def extend(self, items: list[Any]) -> None:
        self._last(list).extend(items)

    def update(self, items: list[Any]) -> None:
        self._last(dict).update(_pairs(items))

    def _last(self, kind: type) -> Any:
        if type(self.values[-1]) is not kind:
            raise RefusedError(f"has a damaged pickle (no {kind.__name__} to add to)")
        return self.values[-1]

    def name(self, module_name: object, global_name: object) -> None:
        names = module_name, global_name
        if not all(type(name) is str for name in names):
            raise RefusedError("has a damaged pickle (a name that is no text)")
        module, member = map(str, names)
        module = module.replace("numpy._core", "numpy.core").replace("__builtin__", "builtins")
        if (module, member) not in _MAKERS:
            raise RefusedError(
                f"is a pickle that names {ascii(module[:40])[1:-1]}.{ascii(member[:40])[1:-1]}: "
                "only arrays and plain containers are read, and nothing is executed"
            )
        self.push(_MAKERS[module, member])

    def call(self) -> None:
        maker, arguments = self.take(2)
        if not callable(maker):  # only what is named is
            raise RefusedError("calls what is no array")
        self.push(maker(self, *_few(arguments)))

    def build(self) -> None:
        (state,) = self.take(1)
        made = self.values[-1]
        if isinstance(made, StoredArray):
            *_, shape, kind, by_column, content = _few(state)
            made.values = self.array(content, kind, shape, by_column=by_column)
        elif isinstance(made, _Kind):
            made.order = ">" if _few(state)[1] == ">" else "<"
        else:
            raise RefusedError("changes what is no array")

    def array(
        self, content: object, kind: object, shape: object, *, by_column: object = False
    ) -> npt.NDArray[Any] | list[Any]:
        """Values of an array, from bytes or from a list of objects."""
        lengths = _few(shape, MOST_AXES)
        right = all(type(one) is int and 0 <= one < 1 << 63 for one in lengths)
        if not isinstance(kind, _Kind) or not right:
            raise RefusedError("has an array without a type or a shape")
        size = math.prod(lengths)
        if type(content) is list and kind.name.startswith("O") and len(content) == size:
            return content
        data = self.encode(content) if type(content) is str else content
        dtype = np.dtype(kind.order + kind.name)
        if not isinstance(data, bytes | bytearray):
            raise RefusedError("has an array without values")
        return np.frombuffer(data, dtype).reshape(lengths, order="F" if by_column is True else "C")

    def encode(self, text: object, *_: object) -> bytes:
        """Bytes that old pickles have as text; all of them together are no longer than these."""
        if type(text) is not str or (together := self._encoded + len(text)) > self._size:
            raise RefusedError("has a damaged pickle (more texts of bytes than it has bytes)")
        self._encoded = together
        return text.encode("latin-1")

    def of_buffer(self, content: object, kind: object, shape: object, order: object) -> StoredArray:
        made = StoredArray()
        made.values = self.array(content, kind, shape, by_column=order == "F")
        return made

    def scalar(self, kind: object, content: object) -> float | int | bool:
        number: float | int | bool = np.asarray(self.array(content, kind, ())).item()
        return number


_CORE = "numpy.core.multiarray"
_MAKERS: Mapping[tuple[str, str], Callable[..., Any]] = {
    (_CORE, "_reconstruct"): lambda *_: StoredArray(),
    (_CORE, "scalar"): _Stack.scalar,
    ("numpy.core.numeric", "_frombuffer"): _Stack.of_buffer,
    ("numpy", "ndarray"): lambda *_: StoredArray(),
    ("numpy", "dtype"): lambda _, name, *__: _Kind(name),
    ("builtins", "bytes"): lambda _: b"",  # how none are written in old pickles
    ("_codecs", "encode"): _Stack.encode,
}
"""What stands for the functions and classes that a pickle may name."""


def _few(values: object, most: int = MOST_ARGUMENTS) -> tuple[Any, ...]:
    if type(values) is not tuple or len(values) > most:
        raise RefusedError("has an array without a type or a shape")
    return values


def _pairs(items: list[Any]) -> dict[Any, Any]:
    if len(items) % 2 or not all(type(key) in _KEYS for key in items[::2]):
        raise RefusedError("has a dictionary with other keys than numbers and texts")
    return dict(zip(items[::2], items[1::2], strict=True))


_VALUES = frozenset({
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT", "STRING",
    "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "BINUNICODE8", "SHORT_BINUNICODE",
    "BINBYTES", "BINBYTES8", "SHORT_BINBYTES", "BYTEARRAY8",
})  # fmt: skip
"""Steps that make the number, text or bytes that they contain."""

_STEPS: Mapping[str, Callable[[_Stack, Any], object]] = {
    **dict.fromkeys(("PROTO", "FRAME", "STOP"), lambda _, __: None),
    **dict.fromkeys(_VALUES, lambda stack, value: stack.push(value)),
    "NONE": lambda stack, _: stack.push(None),
    "NEWTRUE": lambda stack, _: stack.push(value=True),
    "NEWFALSE": lambda stack, _: stack.push(value=False),
    "MARK": lambda stack, _: stack.mark(),
    "EMPTY_LIST": lambda stack, _: stack.push([]),
    "EMPTY_DICT": lambda stack, _: stack.push({}),
    "EMPTY_TUPLE": lambda stack, _: stack.push(()),
    "LIST": lambda stack, _: stack.push(stack.marked()),
    "DICT": lambda stack, _: stack.push(_pairs(stack.marked())),
    "TUPLE": lambda stack, _: stack.push(tuple(stack.marked())),
    "TUPLE1": lambda stack, _: stack.push(tuple(stack.take(1))),
    "TUPLE2": lambda stack, _: stack.push(tuple(stack.take(2))),
    "TUPLE3": lambda stack, _: stack.push(tuple(stack.take(3))),
    "APPEND": lambda stack, _: stack.extend(stack.take(1)),
    "APPENDS": lambda stack, _: stack.extend(stack.marked()),
    "SETITEM": lambda stack, _: stack.update(stack.take(2)),
    "SETITEMS": lambda stack, _: stack.update(stack.marked()),
    **dict.fromkeys(("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"), _Stack.remember),
    **dict.fromkeys(("GET", "BINGET", "LONG_BINGET"), _Stack.remembered),
    "GLOBAL": lambda stack, names: stack.name(*names.split(" ")),
    "STACK_GLOBAL": lambda stack, _: stack.name(*stack.take(2)),
    "REDUCE": lambda stack, _: stack.call(),
    "BUILD": lambda stack, _: stack.build(),
}
"""What each step does; it gets what it contains, which is decoded."""


def unpickled(content: bytes) -> Any:
    """The value of a pickle; arrays in it are `StoredArray`.

    Raises:
        RefusedError: It has other objects than arrays and plain containers, or is damaged.
    """
    try:
        (value,) = _taken(content).values
    except RefusedError:
        raise
    except (*HEADER_ERRORS, LookupError) as error:
        raise RefusedError(f"has a damaged pickle ({reason_of(error)})") from error
    return value


def _taken(content: bytes) -> _Stack:
    """What all steps have made."""
    stack = _Stack(len(content))
    for number, (step, argument, _) in enumerate(pickletools.genops(content)):
        if step.name not in _STEPS:
            raise RefusedError(f"is a pickle with the step {step.name}, which is not read")
        if number >= MOST_STEPS:
            raise RefusedError(f"is a pickle of more than {MOST_STEPS:,} values")
        _STEPS[step.name](stack, argument)
    return stack


def array_in(value: object) -> npt.NDArray[Any]:
    """Numbers of an array, or of a list of them. Raises RefusedError."""
    stored = value.values if isinstance(value, StoredArray) else value
    if type(stored) is list and all(type(one) in (int, float, bool) for one in stored):
        stored = np.array(stored)
    if not isinstance(stored, np.ndarray) or stored.dtype.kind not in "fiub":
        raise RefusedError("has arrays of other values than numbers")
    return stored


Array = npt.NDArray[Any]
Header = tuple[tuple[int, ...], bool, np.dtype[Any]]

DAMAGE = (
    zipfile.BadZipFile, zlib.error, OSError, NotImplementedError, RuntimeError, *HEADER_ERRORS
)  # fmt: skip
"""Errors that zipfile and NumPy raise for damaged archives."""

LARGEST = 256 * MEGABYTE
"""Largest file of objects that is read [bytes]."""

LARGEST_ARRAY = 16 * 1024 * MEGABYTE
"""Largest array of an archive that is read [bytes]."""


def array_of(content: bytes, what: str) -> Array:
    """The array of numbers or text that is stored in NumPy's format. Raises ValueError."""
    stream = io.BytesIO(content)
    shape, by_column, kind = _header(stream, len(content), what)
    if kind.hasobject:
        raise ValueError(f"{what} has other values than numbers and text")
    values = np.frombuffer(content, kind, offset=stream.tell())
    return values.reshape(shape, order="F" if by_column else "C")


def _header(stream: IO[bytes], size: int, what: str, *, check: bool = True) -> Header:
    """Shape, order and type of an array of so many bytes, at whose values the stream is then."""
    version = np.lib.format.read_magic(stream)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is None:
        raise ValueError(f"{what} is of an unknown version")
    shape, by_column, kind = read_header(stream)
    if check and not kind.hasobject and math.prod(shape) * kind.itemsize != size - stream.tell():
        raise ValueError(f"{what} is not an array of its size")
    return shape, by_column, kind


def stored_objects(path: Path) -> list[Any] | None:
    """The objects of an .npy file, one of them or a row; None: it is an array of numbers or text.

    No pickle is executed, see `unpickled`.

    Raises:
        RefusedError: The file is no such file, damaged, too large, or has other objects.
        OSError: It cannot be read.
    """
    with path.open("rb") as stream:
        if stream.read(6) != b"\x93NUMPY":
            raise RefusedError("is no .npy file")
        stream.seek(0)
        try:
            kind = _header(stream, path.stat().st_size, "it", check=False)[2]
        except HEADER_ERRORS as error:
            raise RefusedError(f"is no .npy file ({reason_of(error)})") from error
        if not kind.hasobject:
            return None
        if path.stat().st_size > LARGEST:
            raise RefusedError(f"has more than the {LARGEST / MEGABYTE:,.0f} MB that are read")
        stored = unpickled(stream.read())
    values = stored.values if isinstance(stored, StoredArray) else None
    if not isinstance(values, list):
        raise RefusedError("has no objects")
    return values


class Archive:
    """The arrays of an .npz file, of which only the names and sizes are read at first.

    No pickle is executed, see `unpickled`.
    """

    def __init__(self, file: Path | IO[bytes]) -> None:
        self.file = file
        with self._opened() as archive:
            entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
        self._entries, self.names = entries, entries.keys()

    @property
    def size(self) -> int:
        """Size of all arrays together [bytes]."""
        return sum(entry.file_size for entry in self._entries.values())

    def values(self, name: str) -> Array:
        """An array of numbers or text. Raises RefusedError."""
        with self._opened(name) as archive:
            return array_of(archive.read(self._entries[name]), name)

    @contextmanager
    def _opened(self, name: str = "") -> Iterator[zipfile.ZipFile]:
        """The archive, if its array of that name is not too large. Raises RefusedError."""
        try:
            with zipfile.ZipFile(self.file) as archive:
                if name:
                    self._check(name)
                yield archive
        except RefusedError:
            raise
        except DAMAGE as error:
            raise RefusedError(f"is damaged, or no .npz file ({reason_of(error)})") from error

    def _check(self, name: str) -> None:
        if name not in self.names:
            raise RefusedError(f"the array {name} is missing")
        entry = self._entries[name]
        if entry.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
            raise RefusedError(f"the array {name} is compressed in an unknown way")
        if entry.file_size > LARGEST_ARRAY:
            raise RefusedError(
                f"the array {name} has {entry.file_size / MEGABYTE:,.0f} MB, more than the "
                f"{LARGEST_ARRAY / MEGABYTE:,.0f} MB that are read"
            )
