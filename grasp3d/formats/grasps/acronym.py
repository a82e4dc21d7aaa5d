"""HDF5 in the layout of the ACRONYM data set.

| data set | written | read |
|---|---|---|
| `grasps/transforms` (k, 4, 4) | hand, x closing [m] | TCP `base_to_tcp` of the gripper along z; without a gripper that of the file, else 0.105 m, the data set's hand |
| `grasps/qualities/flex/object_in_gripper` (k,) | `outcome`, where any is known | `outcome` |
| `object/file` `object/scale` | `object_file`; `object_scale`, else metres per unit of the mesh's file | poses belong to the mesh after scaling |
| `object/com` `object/mass` `object/density` `object/friction` `object/volume` `object/inertia` | settings of these names | settings |
| `gripper/type` | name | name; `panda` where there is none |
| `gripper/base_to_tcp` | only by grasp3d | |

At most 1,000,000 grasps.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.errors import ContactError
from grasp3d.formats.checks import library, outcomes_of
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.frames import FRAMES
from grasp3d.system.documents import package_version
from grasp3d.system.files import atomic_write
from grasp3d.system.names import reason_of

BASE_TO_TCP = 0.105
"""Distance from the hand's base to the TCP of the data set's only gripper [m]."""

GRIPPER = "panda"
"""Name of that gripper, which is assumed if a file states none."""

MOST = 1_000_000
"""Largest number of grasps of a file that is read."""

TRANSFORMS = "grasps/transforms"
OUTCOME = "grasps/qualities/flex/object_in_gripper"

OBJECT = {"com": (3,), "density": (), "friction": (), "inertia": (3, 3), "mass": (), "volume": ()}
"""Shapes of the data sets in `object/` besides file and scale."""


def write(path: Path, poses: GraspPoses) -> None:
    """Write the poses of the hand's base, and outcomes where any are known."""
    h5py = library("h5py", "h5py")
    hand: Any = poses.hand
    values: dict[str, Any] = {
        TRANSFORMS: poses.poses,
        "object/file": poses.object_file or "",
        "object/scale": poses.object_scale,
        "gripper/type": hand.name,
        "gripper/base_to_tcp": hand.base_to_tcp,
    }
    if (known := ~np.isnan(poses.outcome)).any():
        values[OUTCOME] = poses.outcome.astype(np.int64) if known.all() else poses.outcome
    for name in OBJECT:
        stated = poses.settings.get(name)
        if not isinstance(stated, str | None):  # a friction interval is a text
            values[f"object/{name}"] = np.asarray(stated, dtype=np.float64)
    with atomic_write(path) as part, h5py.File(part, "w") as file:
        file.attrs["grasp3d"] = package_version()
        for name, value in values.items():
            file[name] = value


TEXTS = "OS"
"""NumPy kinds of texts: of any length, and of a fixed length."""


def read(path: Path, given: Given) -> GraspPoses:
    """Poses in the order of the file. Raises ContactError, OSError."""
    h5py = library("h5py", "h5py")
    if not h5py.is_hdf5(path):
        raise ContactError("is not an HDF5 file")
    try:
        with h5py.File(path, "r") as file:
            return _read(file, given)
    except (OSError, RuntimeError, KeyError, TypeError, OverflowError) as error:
        raise ContactError(f"is damaged, or not such an HDF5 file ({reason_of(error)})") from error


def _read(file: Any, given: Given) -> GraspPoses:
    if TRANSFORMS not in file:
        raise ContactError(f"the data set {TRANSFORMS} is missing")
    shape: tuple[int, ...] = getattr(file[TRANSFORMS], "shape", ())
    if len(shape) != 3 or shape[1:] != (4, 4) or shape[0] > MOST:
        raise ContactError(f"{TRANSFORMS} must be (k, 4, 4), k at most {MOST}; got {shape}")
    if not (count := shape[0]):
        raise ContactError("there are no grasps in it")
    of_object = {name: _values(file, f"object/{name}", size) for name, size in OBJECT.items()}
    frame = FRAMES["acronym"]
    if given.hand is None:
        ahead = _values(file, "gripper/base_to_tcp", ())
        ahead = BASE_TO_TCP if ahead is None else float(ahead)
        frame = replace(frame, origin="tcp", ahead=ahead, name="")
    scale = _values(file, "object/scale", ())
    names = _of_each(file, count) if given.outcome else [OUTCOME] * (OUTCOME in file)

    def of_each(name: str) -> Any:
        return _values(file, name, (count,), f"fiub{TEXTS}")

    return GraspPoses(
        poses=_values(file, TRANSFORMS, shape),
        outcome=outcomes_of(given.outcome, count, names, of_each, default=(OUTCOME,)),
        hand=_text(file, "gripper/type") or GRIPPER,
        object_file=_text(file, "object/file"),
        object_scale=None if scale is None else float(scale),
        settings={name: one.tolist() for name, one in of_object.items() if one is not None},
        gripper_frame=frame,
    )


def _of_each(file: Any, count: int) -> list[str]:
    """Paths of the data sets below grasps/ that have one value for each grasp."""
    found: dict[str, Any] = {}
    file["grasps"].visititems(found.__setitem__)
    return [f"grasps/{k}" for k, one in found.items() if getattr(one, "shape", 0) == (count,)]


def _values(file: Any, name: str, shape: tuple[int, ...], kinds: str = "fiub") -> Any:
    """Numbers of a data set, or texts if their kinds are allowed; None: it is missing."""
    if name not in file:
        return None
    data = file[name]
    if getattr(data, "shape", None) != shape:
        raise ContactError(f"{name} must be a data set of shape {shape}; got {data!r:.80}")
    if data.dtype.kind not in kinds:
        wanted = "text" if kinds == TEXTS else "numbers"
        raise ContactError(f"{name} must be {wanted} of shape {shape}; got {data.dtype}")
    is_text = data.dtype.kind in TEXTS
    return data.asstr(errors="replace")[()] if is_text else np.asarray(data[()] * 1.0)


def _text(file: Any, name: str) -> str | None:
    """A text; None: it is missing, or empty."""
    return _values(file, name, (), TEXTS) or None


register(Format(
    name="acronym", title="ACRONYM", suffixes=(".h5", ".hdf5"), frame="acronym",
    states_frame=True, alone=True, needs=("h5py", "h5py"), sniff=lambda _: True, read=read,
    write=write, holds="the data set grasps/transforms", about=__doc__ or "",
))  # fmt: skip
