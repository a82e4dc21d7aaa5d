"""Poses as HDF5 in the layout of the ACRONYM data set."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.grasps.pose_files.frames import Given, joint_values
from grasp3d.grasps.pose_files.outcomes import Values, outcomes_of
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.frames import FRAMES
from grasp3d.system.files import atomic_write
from grasp3d.system.versions import package_version

WHAT = "ACRONYM"

BASE_TO_TCP = 0.105
"""From the hand's base to the TCP in the data set, which has one gripper [m]."""

MOST = 1_000_000
"""Most grasps of a file that are read."""

LONGEST = 1 << 20
"""Longest text and largest chunk, in elements, that are read."""

TRANSFORMS = "grasps/transforms"
OUTCOME = "grasps/qualities/flex/object_in_gripper"
NUMBERS = {
    "opening": "grasps/opening",
    "pregrasp_opening": "grasps/pregrasp_opening",
    "scores": "grasps/scores",
}
"""Further data sets, which only files of this project have."""
NAMES = "grasps/names"

MOST_NAMES = 1000
"""Most data sets of one value for each grasp that are looked at."""

OBJECT = {
    "com": (3,), "density": (), "friction": (), "inertia": (3, 3), "mass": (), "volume": (),
}  # fmt: skip
"""Shape of what `object/` has beside file and scale."""


def write_acronym(path: Path, poses: GraspPoses) -> None:
    """Write the poses of the hand's base, and outcomes where any are known."""
    h5py = h5py_module()
    hand: Any = poses.hand
    values: dict[str, Any] = {
        TRANSFORMS: poses.poses,
        "object/file": poses.object_file or "",
        "object/scale": poses.object_scale,
        "gripper/type": hand.name,
        "gripper/base_to_tcp": hand.base_to_tcp,
        NAMES: np.array(poses.names, dtype=object),
    }
    if hand.joint_names:
        widest = np.array([hand.max_opening])
        values["gripper/configuration"] = joint_values(hand, widest, WHAT)[0]
    if not np.isnan(poses.outcome).all():
        complete = not np.isnan(poses.outcome).any()
        values[OUTCOME] = poses.outcome.astype(np.int64) if complete else poses.outcome
    for field, name in NUMBERS.items():
        if not np.isnan(getattr(poses, field)).all():
            values[name] = getattr(poses, field)
    for name in OBJECT:
        stated = poses.settings.get(name)
        # An interval of friction is a text.
        if stated is not None and not isinstance(stated, str):
            values[f"object/{name}"] = np.asarray(stated, dtype=np.float64)
    with atomic_write(path) as part, h5py.File(part, "w") as file:
        file.attrs["grasp3d"] = package_version()
        for name, value in values.items():
            file[name] = value


def read_acronym(path: Path, given: Given) -> GraspPoses:
    """Poses in the order of the file. Raises ContactError, OSError."""
    h5py_module()
    with path.open("rb") as stream:
        if stream.read(8) != b"\x89HDF\r\n\x1a\n":
            raise ContactError("is no HDF5 file")
    with _plain_errors(), h5py_module().File(path, "r") as file:
        return _read(_DataSets(file), given)


def _read(data: "_DataSets", given: Given) -> GraspPoses:
    transforms = data.named(TRANSFORMS)
    if transforms is None:
        raise ContactError(f"the data set {TRANSFORMS} is missing")
    shape = transforms.shape
    if len(shape) != 3 or shape[1:] != (4, 4) or shape[0] > MOST:
        raise ContactError(
            f"{TRANSFORMS} must have the shape (k, 4, 4), k at most {MOST}; got {shape}"
        )
    count = shape[0]
    if not count:
        raise ContactError("there are no grasps in it")
    bases = data.numbers(TRANSFORMS, shape)
    further = {field: data.numbers(name, (count,)) for field, name in NUMBERS.items()}
    stated = {name: data.numbers(f"object/{name}", shape) for name, shape in OBJECT.items()}
    scale = data.numbers("object/scale", ())
    settings = {name: one.tolist() for name, one in stated.items() if one is not None}
    frame = FRAMES["acronym"]
    if given.hand is None:
        base_to_tcp = data.numbers("gripper/base_to_tcp", ())
        ahead = BASE_TO_TCP if base_to_tcp is None else float(base_to_tcp)
        frame = replace(frame, origin="tcp", ahead=ahead, name="")
    values: dict[str, Any] = {field: one for field, one in further.items() if one is not None}
    return GraspPoses(
        poses=np.asarray(bases),
        outcome=outcomes_of(
            given.outcome,
            count,
            data.of_grasps(count) if given.outcome else [OUTCOME] if OUTCOME in data else [],
            lambda name: data.values(name, (count,)),
            default=(OUTCOME,),
        ),
        names=data.texts(NAMES, (count,)),
        hand=next(iter(data.texts("gripper/type", ())), None),
        object_file=next(iter(data.texts("object/file", ())), None) or None,
        object_scale=None if scale is None else float(scale),
        settings=settings,
        gripper_frame=frame,
        **values,
    )


class _DataSets:
    """Data sets of an HDF5 file, whose shapes and types are checked before anything is loaded."""

    def __init__(self, file: Any) -> None:
        self._file, self._h5py = file, h5py_module()

    def __contains__(self, name: str) -> bool:
        return self.named(name) is not None

    def named(self, name: str) -> Any:
        """A data set that is stored in the file itself; None: there is none."""
        node, h5py = self._file, self._h5py
        for part in name.split("/"):
            link = node.get(part, getlink=True) if isinstance(node, h5py.Group) else None
            if link is None:
                return None
            if not isinstance(link, h5py.HardLink):
                raise ContactError(
                    f"{name} is a link to another file or data set, which is not read"
                )
            node = node[part]
        if not isinstance(node, h5py.Dataset):
            raise ContactError(f"{name} must be a data set; got a group")
        if node.external or node.is_virtual:
            raise ContactError(f"{name} is stored in another file, which is not read")
        return node

    def of_grasps(self, count: int) -> list[str]:
        """Paths of the data sets below grasps/ that have one value of each grasp."""
        found: list[str] = []

        def visit(name: str, node: Any) -> bool | None:
            if getattr(node, "shape", None) == (count,):
                found.append(f"grasps/{name}")
            return len(found) == MOST_NAMES or None  # which ends the visit

        self._file["grasps"].visititems(visit)
        return found

    def values(self, name: str, shape: tuple[int, ...]) -> Values:
        """Texts or numbers of a data set that there is."""
        data = self.named(name)
        if self._h5py.check_string_dtype(data.dtype) is not None:
            return self.texts(name, shape)
        numbers = self.numbers(name, shape)
        assert numbers is not None
        return numbers

    def numbers(self, name: str, shape: tuple[int, ...]) -> Floats | None:
        """Numbers of a data set; None: it is missing."""
        data = self.named(name)
        if data is None:
            return None
        if data.shape != shape or data.dtype.kind not in "fiub":
            raise ContactError(
                f"{name} must be numbers of shape {shape}; got {data.dtype} of shape {data.shape}"
            )
        if data.chunks is not None and np.prod(data.chunks, dtype=np.float64) > 16 * MOST:
            raise ContactError(f"{name} is stored in chunks of {data.chunks}, too large to be read")
        return np.asarray(data[()], dtype=np.float64)

    def texts(self, name: str, shape: tuple[int, ...]) -> tuple[str, ...]:
        """Texts of a data set; none if it is missing."""
        data = self.named(name)
        if data is None:
            return ()
        info = self._h5py.check_string_dtype(data.dtype)
        if data.shape != shape or info is None or (info.length or 0) > LONGEST:
            raise ContactError(f"{name} must be text of shape {shape}; got shape {data.shape}")
        texts = data.asstr(errors="replace")[()]
        return tuple(map(str, np.ravel(texts).tolist()))


@contextmanager
def _plain_errors() -> Iterator[None]:
    """Raise what HDF5 reports of damaged files as ContactError."""
    try:
        yield
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ContactError(f"is damaged, or no such HDF5 file ({reason})") from error


def h5py_module() -> Any:
    """The library of HDF5. Raises OutputError if it is not installed."""
    if find_spec("h5py") is None:
        raise OutputError("HDF5 needs h5py: pip install 'grasp3d[datasets]'")
    import h5py

    return h5py
