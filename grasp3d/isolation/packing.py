"""Calls as bytes: whoever only hands them on needs none of the modules that they are about."""

import contextlib
import os
import pickle
from collections.abc import Callable
from typing import Any

import cloudpickle


def packed(function: Callable[..., Any], *arguments: object) -> bytes:
    """Pickle a call, what belongs to a script by value."""
    data: bytes = cloudpickle.dumps((function, arguments))
    return data


def called(data: bytes, folder: str = "") -> bytes:
    """Do a call from `packed`; gives its result, pickled.

    Args:
        data: The call.
        folder: Where it works, if that folder is there: a relative path then means the same as for
            whoever packed the call.

    Raises:
        TypeError: The result cannot be pickled.
    """
    if folder:
        with contextlib.suppress(OSError):
            os.chdir(folder)
    function, arguments = pickle.loads(data)  # noqa: S301, from whoever started this process
    return dumped(function(*arguments))


def dumped(value: object) -> bytes:
    """Pickle a result.

    Raises:
        TypeError: It cannot be pickled.
    """
    try:
        data: bytes = cloudpickle.dumps(value)
    except MemoryError:
        raise
    except Exception as error:
        raise TypeError(f"its result cannot be pickled: {error}") from error
    return data


def unpacked(data: bytes) -> Any:  # noqa: ANN401, whatever was packed
    """Read a result from `called`."""
    return pickle.loads(data)  # noqa: S301, made by our own child
