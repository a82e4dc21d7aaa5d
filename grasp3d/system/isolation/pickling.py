"""Pickled calls and results: a process that passes them on need not import their modules."""

import contextlib
import os
import pickle
from collections.abc import Callable
from typing import Any

import cloudpickle


def pickle_call(function: Callable[..., Any], *arguments: object) -> bytes:
    """Pickle a function call; functions and classes of a script are pickled by value."""
    data: bytes = cloudpickle.dumps((function, arguments))
    return data


def run_pickled_call(data: bytes, folder: str = "") -> bytes:
    """Run a call from `pickle_call`, and return its pickled result.

    Args:
        data: The call.
        folder: Working folder, if it exists, so that relative paths mean the same as where the
            call was pickled.

    Raises:
        TypeError: The result cannot be pickled.
    """
    if folder:
        with contextlib.suppress(OSError):
            os.chdir(folder)
    function, arguments = pickle.loads(data)  # noqa: S301, from the process that started this one
    return pickle_result(function(*arguments))


def pickle_result(value: object) -> bytes:
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


def unpickle_result(data: bytes) -> Any:
    """Return the result from the bytes of `run_pickled_call`."""
    return pickle.loads(data)  # noqa: S301, from a child process of ours
