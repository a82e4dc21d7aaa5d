"""Encoding of the pages' data: JSON without markup characters, arrays as base64."""

import base64
import gzip
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.system.names import printable

LEVEL = 6
"""Level of the compression; higher levels take longer and save next to nothing."""

STEPS = 65_535
"""Steps of a quantised coordinate over the bounding box of the surface."""

_MARKUP = {ord(character): f"\\u{ord(character):04x}" for character in "<>&"}


def json_text(value: Any) -> str:
    """Write JSON in ASCII without markup characters, which any script element can contain.

    Args:
        value: Numbers that are not finite become null; control characters are escaped.
    """
    text = json.dumps(_plain(value), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.translate(_MARKUP)


def pack_arrays(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[list[tuple[str, str, int]], str]:
    """Pack arrays one after the other.

    Args:
        arrays: By name; unsigned integers of 8, 16 or 32 bits, or floats of 32 bits.

    Returns:
        Name, type and number of values of each; and their bytes, little-endian, compressed, in
        base64.
    """
    header, parts = [], []
    for name, values in arrays.items():
        kind = f"{values.dtype.kind}{values.dtype.itemsize}"
        header.append((name, kind, values.size))
        parts.append(np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes())
    data = gzip.compress(b"".join(parts), compresslevel=LEVEL, mtime=0)
    return header, base64.b64encode(data).decode("ascii")


def quantised(
    points: npt.NDArray[np.float64], low: npt.NDArray[np.float64], step: npt.NDArray[np.float64]
) -> npt.NDArray[np.uint16]:
    """Quantise coordinates: the number of steps above `low`; nan becomes 0.

    Args:
        points: Shape (..., 3).
        low: Lowest corner of the box, shape (3,).
        step: Length of a step, shape (3,); above 0.
    """
    numbers = np.rint((np.nan_to_num(points, nan=0.0) - low) / step)
    return np.clip(numbers, 0, STEPS).astype(np.uint16)


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
