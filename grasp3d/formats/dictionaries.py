"""Grasps of hands with joints in dictionaries, which are pickles in .npy files.

A file has one dictionary with one grasp or many, or a list of them; a folder has such files.
Nothing in them is executed. A pickle may call whatever it names; of names only those are known here
with which NumPy makes arrays, types and scalars, and functions of ours stand for them.
"""

import io
import math
import pickle
import re
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import HEADER_ERRORS, Floats
from grasp3d.errors import ContactError
from grasp3d.formats.checks import entries_of, load_array, outcomes_of
from grasp3d.formats.format import Given
from grasp3d.formats.frames import from_quaternions, quaternions
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.postures import matched, wrist_of
from grasp3d.hand.frames import FRAMES, GripperFrame, ObjectPose
from grasp3d.hand.robot_files import NAMES as HANDS
from grasp3d.system.documents import described, is_folder
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
        raise RefusedError(f"is damaged, or not a .npy file ({reason_of(error)})") from error
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


Rows = dict[str, Any]
"""What a dictionary of a file states of its grasps."""

Content = Sequence[Rows]

ALL_STAGES = {"pregrasp": "pregrasp_", "grasp": "", "squeeze": "squeeze_"}
"""In the order in which files have them, and how names of fields begin."""

POSE, ORDER = 7, [0, 1, 2, 4, 5, 6, 3]
"""Numbers of a pose: x, y, z [m] and the quaternion w, x, y, z; those of x, y, z and w last."""

SAME = 1e-6
"""Largest difference of poses and scales of one object."""

MOST_FILES, MOST_GRASPS = 100_000, 1_000_000
"""Most files of a folder, and grasps, that are read."""

DEEPEST = 3
"""Most lists within each other that are read as an array: a list may contain itself."""

SUFFIX = ".npy"


def load_npy(path: Path) -> Any:
    """An array of numbers, or the dictionaries, each with the `name` of its file in a folder.

    Args:
        path: An .npy file, or a folder of them.

    Raises:
        ContactError: There is no such file.
    """
    if not is_folder(path):
        with path.open("rb") as stream:
            is_plain = b"'descr': '|O'" not in stream.read(200)
        return load_array(path) if is_plain else _of_file(path, "")
    files = sorted(one for one in path.rglob("*") if one.suffix.lower() == SUFFIX)
    if not files or len(files) > MOST_FILES:
        raise ContactError(f"has {len(files):,} files {SUFFIX}; from 1 to {MOST_FILES:,} are read")
    names = {file: file.relative_to(path).with_suffix("").as_posix() for file in files}
    words = {word for name in names.values() for word in re.split("[^a-z]+", name.lower())}
    _only(words & {*HANDS}, "hands")  # their joints may be as many
    found: list[Rows] = []
    for file, name in names.items():
        try:
            found += _of_file(file, name)
        except (ContactError, ValueError, OSError) as error:
            raise ContactError(f"{file.relative_to(path)}: {error}") from error
    return found


def _only(found: AbstractSet[Any], what: str) -> Any:
    """What all files state; None: nothing. Raises ContactError if it differs."""
    if len(found) > 1:
        listed = " and ".join(sorted(f"{one!s:.60}" for one in found)[:2])
        said = f"has grasps of {len(found)} {what}, such as {listed}"
        raise ContactError(f"{said}: put the files of each into a folder of their own")
    return next(iter(found), None)


def _of_file(path: Path, name: str) -> list[Rows]:
    content: Any = stored_objects(path) or []
    listed = content[0] if len(content) == 1 and isinstance(content[0], list) else content
    rows = entries_of(listed, "its content")
    return [{**one, "name": name} for one in rows]


def rows_in(value: Any, what: str) -> Floats:
    """Rows of numbers of a value of a dictionary, shape (n, p). Raises ContactError."""
    values = numbers_in(value, what)
    return values.reshape(-1, values.shape[-1])


def numbers_in(value: Any, what: str, deep: int = 0) -> Floats:
    """Numbers of a value of a dictionary, also in lists. Raises ContactError."""
    is_nested = isinstance(value, list) and any(type(one) not in (int, float) for one in value)
    if is_nested and deep < DEEPEST:
        parts = [numbers_in(one, what, deep + 1) for one in value[: MOST_GRASPS + 1]]
        if len({part.shape for part in parts}) == 1:
            return np.stack(parts)
    try:
        array = array_in([value] if isinstance(value, int | float | np.generic) else value)
    except RefusedError as error:
        stored = value.ravel().tolist() if isinstance(value, np.ndarray) else value
        raise ContactError(f"{what} must be numbers; got {described(stored)}") from error
    if not array.size:
        raise ContactError(f"{what} must be numbers; there are none")
    return array.astype(np.float64)


def texts_in(rows: Rows, key: str) -> list[str]:
    """A text, or a list of texts; empty: it is neither."""
    value = rows.get(key)
    listed = value.ravel().tolist() if isinstance(value, np.ndarray) else value
    listed = listed if isinstance(listed, list) else [listed]
    return [str(one) for one in listed] if all(isinstance(one, str) for one in listed) else []


def grasps_in(
    content: Content, parts: Sequence[Mapping[str, Floats]], given: Given, root: str
) -> GraspPoses:
    """Grasps of all dictionaries, relative to their object. Raises ContactError.

    Args:
        content: The dictionaries.
        parts: Rows of a pose and the joints of each at each stage, shape (n, 7 + p).
        given: The hand, and the scale that is wanted, if there are several.
        root: Link of the poses where the joints of the wrist are not in the file.
    """
    columns, counts = parts[0]["grasp"].shape[1], [len(part["grasp"]) for part in parts]
    for number, part in enumerate(parts, 1):
        for stage, values in part.items():
            if (found := values.shape[1]) != columns or columns <= POSE:
                said = f"dictionary {number}: {stage}_qpos must have {POSE} numbers of a pose and"
                got = f"got {found}, in the first {columns}"
                raise ContactError(f"{said} those of the joints, as many in all; {got}")
    if sum(counts) > MOST_GRASPS:
        raise ContactError(f"it has more than {MOST_GRASPS:,} grasps")
    to_object, object_pose = _object_poses(content, counts)
    fields: dict[str, Any] = {}
    for stage, start in ALL_STAGES.items():
        if all(stage in part for part in parts):
            values = np.concatenate([part[stage] for part in parts])
            fields[f"{start}poses"] = to_object @ from_quaternions(values[:, ORDER])
            fields[f"{start}posture"] = values[:, POSE:]
    joints, wrist = columns - POSE, wrist_of(given.hand)
    names = _only({tuple(texts_in(rows, "joint_names")) for rows in content}, "lists of joints")
    elsewhere = ["in its scene_cfg" for rows in content if "scene_cfg" in rows]
    elsewhere += [text for rows in content for text in texts_in(rows, "scene_path")]
    is_known = not elsewhere or any("obj_pose" in rows for rows in content)
    is_whole = joints == len(given.hand.joint_names)
    files = {file for rows in content for file in texts_in(rows, "obj_path")}
    held = ("succ_flag",) * any("succ_flag" in rows for rows in content)
    poses = GraspPoses(
        **fields,
        joint_names=names if len(names) == joints else (),
        outcome=outcomes_of(
            given.outcome, sum(counts), held, partial(_of_each, content, counts), default=held
        ),
        names=tuple(str(rows["name"]) for rows in content if rows["name"] and max(counts) == 1),
        object_file=_only(files, "objects"),
        object_pose=object_pose,
        gripper_frame=FRAMES["hand"] if is_whole else GripperFrame(link=root),
        settings={} if is_known else {"frame": f"of the scene {elsewhere[-1]}"},
    )  # fmt: skip
    scales = np.repeat([_scale(rows) for rows in content], counts)
    return matched(_of_one_scale(poses, scales, given.object_scale), given.hand, wrist=wrist.joints)


def _of_each(content: Content, counts: Sequence[int], key: str) -> Floats:
    """Numbers of a key for each grasp, nan where a dictionary has none, shape (k,)."""
    values = [np.zeros(0)]
    for rows, count in zip(content, counts, strict=True):
        one = numbers_in([np.nan] if rows.get(key) is None else rows[key], key).ravel()
        if len(one) not in (1, count):
            raise ContactError(f"{key} has {len(one)} values, but there are {count} grasps")
        values.append(np.resize(one, count))
    return np.concatenate(values)


def _object_poses(content: Content, counts: Sequence[int]) -> tuple[Floats, ObjectPose | None]:
    """What takes poses of each grasp to those of the file, and the pose of the object there.

    Where objects have several poses, poses become those relative to the object.
    """
    unmoved = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    stated = (unmoved if rows.get("obj_pose") is None else rows["obj_pose"] for rows in content)
    at = [rows_in(one, "obj_pose")[0] for one in stated]
    if other := [len(one) for one in at if len(one) != POSE]:
        raise ContactError(f"obj_pose must have {POSE} numbers; got {other[0]}")
    poses = from_quaternions(np.stack(at)[:, ORDER], "obj_pose: ")
    if np.abs(poses - poses[0]).max() < SAME:
        same = np.abs(poses[0] - np.eye(4)).max() < SAME
        return np.eye(4), None if same else ObjectPose.of(poses[0])
    return np.asarray(np.linalg.inv(poses)).repeat(counts, axis=0), None


def _of_one_scale(poses: GraspPoses, scales: Floats, wanted: float | None) -> GraspPoses:
    """The grasps of the object at one scale, with this. Raises ContactError."""
    known = np.unique(np.round(scales[np.isfinite(scales)], 9))
    if not len(known):
        return poses
    listed = ", ".join(f"{one:g}" for one in known[:8])
    if wanted is None and len(known) > 1:
        said = f"its grasps are of the object at {len(known)} scales, {listed}: choose one of them"
        raise ContactError(f"{said} (--object-scale, in Python object_scale=...)")
    scale = float(known[0]) if wanted is None else wanted
    chosen = np.flatnonzero(np.abs(scales - scale) <= SAME * scale)
    if not len(chosen):
        raise ContactError(f"no grasps of the object at the scale {scale:g}; known are {listed}")
    some = poses if len(chosen) == poses.count else poses.take(chosen)
    return replace(some, object_scale=scale)


def _scale(rows: Rows) -> float:
    """The scale that a dictionary states; nan: none. Raises ContactError."""
    stated = [rows[key] for key in ("obj_scale", "scale") if rows.get(key) is not None]
    if not stated:
        return np.nan
    values = numbers_in(stated[0], "the scale of the object")
    size = np.abs(values).max()
    if not (0.0 < values.min() <= size < np.inf and np.ptp(values) <= SAME * size):
        raise ContactError(f"the scale of the object must be one number above 0; got {values}")
    return float(values.reshape(-1)[0])


def qpos_of(poses: Floats, posture: Floats) -> Floats:
    """Rows of a pose and joints, shape (k, 7 + p)."""
    return np.hstack([poses[:, :3, 3], quaternions(poses)[:, [3, 0, 1, 2]], posture])


def stages_of(poses: GraspPoses) -> dict[str, Floats]:
    """Rows of a pose and the joints of the stages that are known, in their order."""
    moved, found = poses.of_stages("poses"), {}
    for stage, start in ALL_STAGES.items():
        if (posture := poses.of_stages("posture").get(f"{start}posture")) is not None:
            found[stage] = qpos_of(moved.get(f"{start}poses", poses.poses), posture)
    return found
