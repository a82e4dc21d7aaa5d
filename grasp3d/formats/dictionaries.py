"""Grasps of hands with joints in dictionaries, which are pickles in .npy files.

A file has one dictionary with one grasp or many, or a list of dictionaries; a folder has such
files. Nothing in them is executed. A pickle may name any function; only the names with which NumPy
makes arrays, types and scalars are accepted, and functions defined here stand in for them.
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
    """A file is refused; the message gives the reason."""


_KIND = re.compile(r"[<>|=]?([fiu][1248]|f16|b1|[SU]\d{1,6}|O8?)")
"""Types of arrays that are read: numbers, texts, and objects that the pickle itself has made."""


class _Kind:
    """NumPy type in a pickle; of its state only the byte order is used."""

    def __init__(self, name: object, *_: object) -> None:
        if not (isinstance(name, str) and _KIND.fullmatch(name)):
            raise RefusedError(f"has arrays of the type {ascii(name)[:20]}, which are not read")
        self.type = np.dtype(name)

    def __setstate__(self, state: Any) -> None:
        if state[1] in ("<", ">"):
            self.type = self.type.newbyteorder(state[1])


class _Array(np.ndarray):
    """Array in a pickle; checks that its values are of its type and as many as its shape says."""

    def __setstate__(self, state: Any) -> None:
        _, shape, kind, is_fortran, values = state
        count = math.prod(shape) * (1 if kind.type.hasobject else kind.type.itemsize)
        expected = list if kind.type.hasobject else bytes
        if min(shape, default=0) < 0 or type(values) is not expected or len(values) != count:
            raise RefusedError("has an array that is damaged")
        fortran: Any = bool(is_fortran)
        super().__setstate__((1, tuple(map(int, shape)), kind.type, fortran, values))


def _numbers(values: Any, kind: Any, shape: Any = (), order: str = "C") -> Any:
    """Decode numbers from bytes; objects, which would be memory addresses, are refused."""
    if kind.type.hasobject:
        raise RefusedError("has objects where numbers are")
    return np.frombuffer(bytes(values), kind.type).reshape(
        shape, order="F" if order == "F" else "C"
    )


_KNOWN: dict[tuple[str, str], Callable[..., Any]] = {
    ("_codecs", "encode"): lambda text, *_: text.encode("latin-1"),
    ("builtins", "bytes"): lambda *_: b"",  # empty bytes in old pickles
    ("numpy", "ndarray"): lambda *_: None,  # the class that `_reconstruct` makes
    ("numpy.core.multiarray", "_reconstruct"): lambda *_: np.empty(0).view(_Array),
    ("numpy.core.multiarray", "scalar"): lambda kind, values: _numbers(values, kind).item(),
    ("numpy.core.numeric", "_frombuffer"): _numbers,
    ("numpy", "dtype"): _Kind,
}
"""Substitutes for the functions and classes that a pickle may name. NumPy's own are not called,
because they trust what a pickle says about memory."""


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """Return the substitute for a name. Raises RefusedError."""
        module = module.replace("numpy._core", "numpy.core").replace("__builtin__", "builtins")
        if (module, name) not in _KNOWN:
            raise RefusedError(
                f"is a pickle that names {ascii(module[:40])[1:-1]}.{ascii(name[:40])[1:-1]}: "
                "only arrays and plain containers are read, and nothing is executed"
            )

        def made(*given: Any) -> Any:  # a new function, because a pickle may change it
            return _KNOWN[module, name](*given)

        return made


def stored_objects(path: Path) -> list[Any] | None:
    """List the objects of an .npy file; None: it is an array of numbers or text.

    Nothing is executed.

    Raises:
        RefusedError: The file is no .npy file, is damaged, or has other objects.
        OSError: The file cannot be read.
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
    """Array of numbers from an array, or from a list of numbers. Raises RefusedError."""
    if type(value) is list and all(isinstance(one, int | float) for one in value):
        value = np.array(value)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        raise RefusedError("has arrays of other values than numbers")
    return value


Rows = dict[str, Any]
"""A dictionary of a file: what it states about its grasps."""

Content = Sequence[Rows]

ALL_STAGES = {"pregrasp": "pregrasp_", "grasp": "", "squeeze": "squeeze_"}
"""Stages in the order of files, each with the prefix of its fields."""

POSE, ORDER = 7, [0, 1, 2, 4, 5, 6, 3]
"""Number of values of a pose (x, y, z [m], quaternion w, x, y, z); order that puts w last."""

SAME = 1e-6
"""Largest difference at which poses or scales of objects count as equal."""

MOST_FILES, MOST_GRASPS = 100_000, 1_000_000
"""Largest number of files of a folder, and of grasps, that are read."""

DEEPEST = 3
"""Deepest nesting of lists that are read as an array: a list may contain itself."""

SUFFIX = ".npy"


def load_npy(path: Path) -> Any:
    """Load an array of numbers, or dictionaries, each with the `name` of its file in a folder.

    Args:
        path: An .npy file, or a folder of them.

    Raises:
        ContactError: The file holds no grasps, or the folder has too few or too many files, files
            of several hands, or one that cannot be read.
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
    _only(words & {*HANDS}, "hands")  # which may have equally many joints
    found: list[Rows] = []
    for file, name in names.items():
        try:
            found += _of_file(file, name)
        except (ContactError, ValueError, OSError) as error:
            raise ContactError(f"{file.relative_to(path)}: {error}") from error
    return found


def _only(found: AbstractSet[Any], what: str) -> Any:
    """The one value that all files state; None: none. Raises ContactError if they differ."""
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
    """Convert a value of a dictionary to rows of numbers, shape (n, p). Raises ContactError."""
    values = numbers_in(value, what)
    return values.reshape(-1, values.shape[-1])


def numbers_in(value: Any, what: str, deep: int = 0) -> Floats:
    """Convert a value of a dictionary, also nested lists, to numbers. Raises ContactError."""
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
    """The texts of a value that is a text or a list of texts; empty: it is neither."""
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
        parts: For each dictionary, rows of a pose and joint values by stage, shape (n, 7 + p).
        given: The hand, and the scale to choose, if there are several.
        root: Link that the poses refer to if the file lacks the joints of the wrist.
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
    """Transforms of the poses of each grasp, and the pose of the object in the file.

    If the object's pose differs between grasps, the transforms make poses relative to the object.
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
    """Choose the grasps at one scale of the object, and state the scale. Raises ContactError."""
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
    """Rows of a pose and joint values, shape (k, 7 + p)."""
    return np.hstack([poses[:, :3, 3], quaternions(poses)[:, [3, 0, 1, 2]], posture])


def stages_of(poses: GraspPoses) -> dict[str, Floats]:
    """Rows of a pose and joint values for each known stage, in their order."""
    moved, found = poses.of_stages("poses"), {}
    for stage, start in ALL_STAGES.items():
        if (posture := poses.of_stages("posture").get(f"{start}posture")) is not None:
            found[stage] = qpos_of(moved.get(f"{start}poses", poses.poses), posture)
    return found
