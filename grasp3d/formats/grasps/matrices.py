"""Matrices of NumPy: an array (k, 4, 4), or (4, 4) for one grasp.

The poses are those of the TCP, unless `--frame` states another frame, in the unit of the mesh or a
given one (`--unit`). The file contains nothing else.
"""

from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.formats.checks import write_array
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import GraspPoses


def sniff(content: Any) -> bool:
    """Whether content is an array of such matrices."""
    shape: tuple[int, ...] = getattr(content, "shape", ())
    return len(shape) in {2, 3} and shape[-2:] == (4, 4)


def read(content: Any, given: Given) -> GraspPoses:
    """Poses of an array. Raises ContactError."""
    return GraspPoses(poses=np.array(content), unit=given.unit, hand=given.hand)


def write(path: Path, poses: GraspPoses) -> None:
    """Write the array."""
    write_array(path, poses.poses)


register(Format(
    name="matrices", title="Matrices", suffixes=(".npy",), unit="stated", hands=(), moves=True,
    sniff=sniff, read=read, write=write, holds="an array (k, 4, 4)", about=__doc__ or "",
))  # fmt: skip
