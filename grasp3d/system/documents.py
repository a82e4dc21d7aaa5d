"""Reading and checking of input files: whether they can be read, and their numbers and texts.

All readers of JSON, YAML, XML, tables and arrays use these functions. Their callers add the name
of the file to the message. Files state the version of the package that wrote them.
"""

import json
import math
import os
import re
import stat
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints


@cache
def package_version() -> str:
    """Return the version of the installed package; cached, since a look-up takes milliseconds."""
    from importlib.metadata import version  # takes a tenth of a second to import

    return version("grasp3d")


def newer_version(version: object) -> str:
    """Return why a file from a newer version of the package is refused; empty: it is accepted.

    Args:
        version: Version that the file states. It may be newer in the third number.

    Example:
        >>> from grasp3d.system.documents import newer_version
        >>> newer_version("99.0.0")[:51]
        'was written by grasp3d 99.0.0, which is newer than '
    """
    own = package_version()
    theirs, ours = (
        [int(one) for one in re.findall(r"\d{1,9}", str(text))[:2]] for text in (version, own)
    )
    if theirs <= ours:
        return ""
    stated = str(version)[:20]
    return f"was written by grasp3d {stated}, which is newer than this one, {own}; update it"


LONGEST_NUMBER = 300
"""Largest number of digits of a whole number; the largest floating-point number has 309."""

_ESCAPED_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def is_file(path: str | Path) -> bool:
    """Whether a path names a regular file; false also for names that no file can have."""
    return os.path.isfile(path)  # noqa: PTH113, pathlib's raises for names that are too long


def is_folder(path: str | Path) -> bool:
    """Whether a path names an existing folder."""
    return os.path.isdir(path)  # noqa: PTH112, as above


def problem_of_file(path: Path) -> str | None:
    """Return why a path is no readable regular file, as a predicate; None: it is one."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return "there is no such file"
    except (OSError, ValueError) as error:
        return f"cannot be opened ({getattr(error, 'strerror', None) or error})"
    if stat.S_ISDIR(status.st_mode):
        return "is a folder; name a file"
    if not stat.S_ISREG(status.st_mode):
        return "is a pipe or a device, not a file"
    return None if os.access(path, os.R_OK) else "cannot be opened (Permission denied)"


def file_bytes(path: Path, most: float = math.inf) -> bytes:
    """Content of a regular file of at most `most` bytes. Raises ValueError, OSError."""
    if problem := problem_of_file(path):
        raise ValueError(problem)
    if path.stat().st_size > most:
        raise ValueError(f"is too large: more than {most:,} bytes")
    return path.read_bytes()


def load_json(path: Path, *, finite: bool = False) -> Any:
    """Content of a JSON file; see `parse_json`. Raises ValueError with the reason, OSError."""
    return parse_json(file_bytes(path), finite=finite)


def parse_json(text: str | bytes, *, finite: bool = False) -> Any:
    """Parse a JSON text into values that are safe to compute with, write and print.

    Args:
        text: The text, or its bytes in UTF-8.
        finite: Whether to refuse NaN and Infinity, which are not JSON but common in JSON files.

    Raises:
        ValueError: The text is not JSON, or has whole numbers that are too large, texts that are
            not Unicode, or nesting that is too deep; the message gives the reason.
    """
    try:
        text = text if isinstance(text, str) else text.decode("utf-8-sig")
        content = json.loads(text, parse_int=_whole, parse_constant=_refuse if finite else None)
    except RecursionError as error:
        raise ValueError("is JSON that is nested too deeply") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"is not valid JSON: {error}") from error
    if _ESCAPED_SURROGATE.search(text):
        check_text(json.dumps(content, ensure_ascii=False))
    return content


def check_text(text: str) -> None:
    """Refuse text with lone surrogates, which no file can contain. Raises ValueError."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ValueError(f"has a text with half a character, {text[error.start]!a}") from error


def number_of(value: object) -> float:
    """Convert a number or its text to a float; nan: it is no number, or too large."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return math.nan
    try:
        return float(value)
    except (ValueError, OverflowError):
        return math.nan


def numbers_of(text: str, count: int) -> list[float]:
    """Parse `count` finite numbers separated by spaces. Raises ValueError with the reason."""
    numbers = [number_of(word) for word in text.split()]
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        raise ValueError(f"must be {expected}; got {described(text)}")
    return numbers


def typed(value: Any, hint: Any) -> Any:
    """Convert a JSON value to a hinted type, and lists to tuples. Raises TypeError if it cannot."""
    kinds = get_args(hint)
    if get_origin(hint) is tuple:
        if type(value) not in {list, tuple} or (... not in kinds and len(value) != len(kinds)):
            raise TypeError(f"{value!r:.50} is not a list of that many values")
        return tuple(typed(item, kinds[0]) for item in value)
    if type(value) is dict and get_origin(hint) is dict:
        return {name: typed(one, kinds[1]) for name, one in value.items()}
    if type(value) is dict and hasattr(hint, "_fields"):  # a named tuple
        types = get_type_hints(hint)
        return hint(**{name: typed(one, types.get(name)) for name, one in value.items()})
    if kinds and get_origin(hint) is not dict:  # a value that may be None
        return None if value is None else typed(value, kinds[0])
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if type(value) is not hint:
        raise TypeError(f"{value!r:.50} is not of type {hint}")
    return value


def described(value: object) -> str:
    """Short description of a value of a document."""
    if isinstance(value, list | tuple):
        words = (one for one in value if isinstance(one, str) and math.isnan(number_of(one)))
        return f"a list of {len(value)}" + "".join(f" with {one!a:.40}" for one in [*words][:1])
    if isinstance(value, dict):
        return "an object"
    return "nothing" if value is None else ascii(value)[:40]


def _refuse(name: str) -> None:
    raise ValueError(f"is not valid JSON: {name} is not a finite number")


def _whole(text: str) -> int:
    if len(text) > LONGEST_NUMBER:
        raise ValueError(f"a number has {len(text)} digits, and at most {LONGEST_NUMBER} are read")
    return int(text)
