"""Grasps of hands with joints: files of DexGraspBench and DexGraspNet.

They are dictionaries, in pickles of .npy files or saved by PyTorch: one with one grasp or many, a
list of them, or a folder of such files. Nothing is executed; see `grasp3d.system.stored_arrays`.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from itertools import count as naturals
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.grasps.pose_files.documents import load_array, numbers_in
from grasp3d.grasps.pose_files.frames import Given, from_quaternions, quaternions
from grasp3d.grasps.pose_files.outcomes import outcomes_of
from grasp3d.grasps.poses import STAGES, GraspPoses
from grasp3d.grasps.postures import as_in_model, matched, wrist_of
from grasp3d.hand.articulated.presets import NAMES as HANDS
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.system.documents import described
from grasp3d.system.files import atomic_write
from grasp3d.system.stored_arrays import StoredArray, stored_objects

Rows = dict[str, Any]
"""What a dictionary of a file states of its grasps: arrays of numbers, texts and lists of them."""

ALL_STAGES = ("pregrasp", "grasp", "squeeze")
"""In the order in which files have them."""

NUMBERS = (
    *(f"{stage}_{what}" for stage in ALL_STAGES for what in ("qpos", "pose")),
    "robot_pose", "obj_pose", "obj_scale", "scale", "succ_flag",
)  # fmt: skip
"""Keys of numbers that are read."""

TEXTS = ("obj_path", "scene_path", "joint_names")
"""Keys of texts that are read; `qpos` is a dictionary."""

TRANSLATION, EULER = ("WRJTx", "WRJTy", "WRJTz"), ("WRJRx", "WRJRy", "WRJRz")
"""Keys of a pose in DexGraspNet: metres, and angles about the fixed axes x, y and z in turn."""

POSE = 7
"""Numbers of a pose: x, y, z [m] and the quaternion w, x, y, z."""

SAME = 1e-6
"""Largest difference of poses and scales of one object."""

MOST_FILES, MOST_GRASPS = 100_000, 1_000_000
"""Most files of a folder, and grasps, that are read."""

DEEPEST = 3
"""Most lists within each other that are read as an array: a list may contain itself."""

SUFFIXES = (".npy", ".pt")


def load_npy(path: Path) -> Any:
    """Content of a file: an array of numbers, or what its dictionaries state. Raises ContactError.

    Args:
        path: An .npy file, one of PyTorch, or a folder of them.
    """
    if path.suffix.lower() == ".npy" and not path.is_dir():
        with path.open("rb") as stream:
            is_plain = b"'descr': '|O'" not in stream.read(200)
        if is_plain:
            return load_array(path)
    if not path.is_dir():
        return _of_file(path, "")
    files = sorted(one for one in path.rglob("*") if one.suffix.lower() in SUFFIXES)
    if not files or len(files) > MOST_FILES:
        raise ContactError(
            f"has {len(files):,} files {' or '.join(SUFFIXES)}; from 1 to {MOST_FILES:,} are read"
        )
    _check_hands([file.relative_to(path).as_posix() for file in files])
    found: list[Rows] = []
    for file in files:
        name = file.relative_to(path).with_suffix("").as_posix()
        try:
            found += _of_file(file, name)
        except (ContactError, ValueError, OSError) as error:
            raise ContactError(f"{file.relative_to(path)}: {error}") from error
    return found


def _check_hands(files: Sequence[str]) -> None:
    """Refuse files that are called after several hands: their joints may be as many."""
    first: dict[str, str] = {}
    for file in files:
        for word in re.split("[^a-z]+", file.lower()):
            if word in HANDS:
                first.setdefault(word, file)
    if len(first) > 1:
        raise ContactError(
            f"has files of {len(first)} hands, such as {' and '.join([*first.values()][:2])}: put "
            "those of each hand into a folder of their own, and evaluate it with its hand"
        )


def _of_file(path: Path, name: str) -> list[Rows]:
    content: Any = _of_torch(path) if path.suffix.lower() == ".pt" else stored_objects(path)
    listed: list[Any] = content if isinstance(content, list) else [content]
    if len(listed) == 1 and isinstance(listed[0], list):
        (listed,) = listed
    if not listed:
        raise ContactError("there are no grasps in it")
    return [_rows(one, f"dictionary {k}", name) for k, one in enumerate(listed, 1)]


def _of_torch(path: Path) -> Any:
    """Content of a file of PyTorch, read without executing anything. Raises ContactError."""
    if find_spec("torch") is None:
        raise ContactError("is a file of PyTorch, which is not installed: save it as .npy")
    torch: Any = import_module("torch")
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # of many kinds: what it refuses, and what is damaged
        reason = " ".join(str(error).split())[:200]
        raise ContactError(f"PyTorch does not read it without executing it ({reason})") from error


def _rows(content: object, what: str, name: str) -> Rows:
    """What is read of a dictionary, checked. Raises ContactError."""
    if not isinstance(content, dict):
        raise ContactError(f"must have dictionaries of grasps; got {described(content)}")
    rows: Rows = {"name": name}
    for key in NUMBERS:
        if content.get(key) is not None:
            rows[key] = _numbers(content[key], f"{what}: {key}")
    for key in TEXTS:
        texts = _texts(content.get(key))
        if texts:
            rows[key] = texts
    if isinstance(content.get("qpos"), dict):
        rows["qpos"] = {
            str(joint): float(_numbers(value, f"{what}: qpos {joint}").reshape(-1)[0])
            for joint, value in content["qpos"].items()
        }
    if isinstance(content.get("scene_cfg"), dict):
        rows.setdefault("scene_path", ["in its scene_cfg"])
    return rows


def _numbers(value: object, what: str, deep: int = 0) -> Floats:
    if hasattr(value, "detach"):
        value = value.detach().cpu().numpy()
    is_nested = isinstance(value, list) and not all(type(v) in (int, float) for v in value)
    if is_nested and deep < DEEPEST:
        parts = [_numbers(one, what, deep + 1) for one in value[:MOST_GRASPS]]  # type: ignore[index]
        if len({part.shape for part in parts}) == 1:
            return np.stack(parts)
    array = numbers_in([value] if isinstance(value, int | float) else value, what)
    if not array.size:
        raise ContactError(f"{what} must be numbers; there are none")
    return array.astype(np.float64)


def _texts(value: object) -> list[str]:
    """A text, or a list of texts; empty: it is neither."""
    stored = value.values if isinstance(value, StoredArray) else value
    listed = stored.ravel().tolist() if isinstance(stored, np.ndarray) else stored
    listed = listed if isinstance(listed, list) else [listed]
    return [str(one) for one in listed] if all(isinstance(one, str) for one in listed) else []


def parse_bench(content: list[Rows], given: Given) -> GraspPoses:
    """Poses of the root of a MuJoCo model, in the order of the files. Raises ContactError.

    Those of all stages in one array, as BODex writes them, are of the root of a URDF file.
    """
    wrist, is_one = wrist_of(given.hand), "robot_pose" in content[0]
    read = _of_all_stages if is_one else _of_bench
    parts = [read(rows, number) for number, rows in enumerate(content, 1)]
    return _grasps(content, parts, given, wrist.beyond if is_one else wrist.before)


def _of_bench(rows: Rows, number: int) -> dict[str, Floats]:
    """Rows of a pose and joints at each stage that a dictionary has, (n, 7 + p) each."""
    if "grasp_qpos" not in rows:
        raise ContactError(f"dictionary {number}: the key grasp_qpos is missing")
    found = {}
    for stage in ALL_STAGES:
        if f"{stage}_qpos" in rows:
            values = _flat(rows[f"{stage}_qpos"])
            if f"{stage}_pose" in rows:  # older files have poses under keys of their own
                values = np.hstack([_flat(rows[f"{stage}_pose"])[: len(values), :POSE], values])
            found[stage] = values
    count = len(found["grasp"])
    for stage, values in found.items():
        if len(values) != count:
            if count != 1:
                raise ContactError(
                    f"dictionary {number}: {stage}_qpos must have {count} rows, as grasp_qpos; got "
                    f"{len(values)}"
                )
            found[stage] = values[:1]  # of several postures on the way the first one
    return found


def _flat(values: Floats) -> Floats:
    return values.reshape(-1, values.shape[-1])


def _of_all_stages(rows: Rows, number: int) -> dict[str, Floats]:
    """The same of an array (..., 3, 7 + p) of all stages."""
    values = rows.get("robot_pose", np.zeros(0))
    if values.ndim < 3 or values.shape[-2] != len(ALL_STAGES):
        raise ContactError(
            f"dictionary {number}: robot_pose must have {len(ALL_STAGES)} rows of each grasp "
            f"(pregrasp, grasp, squeeze) of a hand without an arm; got shape {values.shape}"
        )
    stages = values.reshape(-1, *values.shape[-2:])
    return {stage: stages[:, k] for k, stage in enumerate(ALL_STAGES)}


def parse_net(content: list[Rows], given: Given) -> GraspPoses:
    """Poses of the root of DexGraspNet's model, in the order of the file. Raises ContactError."""
    parts = []
    names = [name for name in content[0].get("qpos", {}) if name not in (*TRANSLATION, *EULER)]
    for number, rows in enumerate(content, 1):
        qpos = rows.get("qpos", {})
        wanted = [*TRANSLATION, *EULER, *names]
        if qpos.keys() ^ {*wanted}:
            other = min(qpos.keys() ^ {*wanted})
            raise ContactError(
                f"grasp {number}: qpos must have {' '.join((*TRANSLATION, *EULER))} and the joints "
                f"of grasp 1; {other!r} is in one of them only"
            )
        values = np.array([qpos[name] for name in wanted])
        turned = Rotation.from_euler("xyz", values[3:6]).as_quat(scalar_first=True)
        parts.append({"grasp": np.concatenate([values[:3], turned, values[6:]])[None]})
    content = [{"joint_names": names, **rows} for rows in content]
    return _grasps(content, parts, given, wrist_of(given.hand).beyond)


def _grasps(
    content: Sequence[Rows],
    parts: Sequence[Mapping[str, Floats]],
    given: Given,
    root: str,
) -> GraspPoses:
    """Grasps of all dictionaries, relative to their object. Raises ContactError.

    Args:
        content: What each dictionary states.
        parts: Poses and joints of each, at each stage.
        given: The scale that is wanted, if there are several.
        hand: The hand.
        root: Link of the poses where the joints of the wrist are not in the file.
    """
    _check_joints(parts)
    counts = [len(part["grasp"]) for part in parts]
    to_object, object_pose = _object_poses(content, counts)
    fields: dict[str, Any] = {}
    for stage in ALL_STAGES:
        if all(stage in part for part in parts):
            values = np.concatenate([part[stage] for part in parts])
            turned = np.roll(values[:, 3:POSE], -1, axis=1)
            prefix = "" if stage == "grasp" else f"{stage}_"
            fields[f"{prefix}poses"] = to_object @ from_quaternions(values[:, :3], turned)
            fields[f"{prefix}posture"] = values[:, POSE:]
    joints = fields["posture"].shape[1]
    found = GraspPoses(
        **fields,
        joint_names=_joint_names(content, joints),
        outcome=_outcome(content, counts, given),
        names=_names(content, counts),
        object_file=_object_file(content),
        object_pose=object_pose,
        gripper_frame=FRAMES["hand"],
        settings=_elsewhere(content),
    )
    found = _of_one_scale(found, content, counts, given.object_scale)
    if joints < len(given.hand.joint_names):
        found = replace(found, gripper_frame=GripperFrame(link=root))
    return matched(found, given.hand, wrist=wrist_of(given.hand).joints)


def _check_joints(parts: Sequence[Mapping[str, Floats]]) -> None:
    """Refuse dictionaries of different numbers of joints. Raises ContactError."""
    columns = parts[0]["grasp"].shape[1]
    for number, part in enumerate(parts, 1):
        for stage, values in part.items():
            if values.shape[1] != columns or columns <= POSE:
                raise ContactError(
                    f"dictionary {number}: {stage}_qpos must have {POSE} numbers of a pose and "
                    f"those of the joints, as many in all; got {values.shape[1]}, in the first "
                    f"{columns}"
                )
    if sum(len(part["grasp"]) for part in parts) > MOST_GRASPS:
        raise ContactError(f"it has more than {MOST_GRASPS:,} grasps")


def _object_poses(
    content: Sequence[Rows], counts: Sequence[int]
) -> tuple[Floats, ObjectPose | None]:
    """What takes poses of each grasp to those of the file, and the pose of the object there.

    Where objects have several poses, poses become those relative to the object.
    """
    unmoved = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    at = [_flat(rows["obj_pose"])[0] if "obj_pose" in rows else unmoved for rows in content]
    if other := [len(one) for one in at if len(one) != POSE]:
        raise ContactError(f"obj_pose must have {POSE} numbers; got {other[0]}")
    values = np.stack(at)
    poses = from_quaternions(values[:, :3], np.roll(values[:, 3:], -1, axis=1), "obj_pose: ")
    if np.abs(poses - poses[0]).max() < SAME:
        same = np.abs(poses[0] - np.eye(4)).max() < SAME
        return np.eye(4), None if same else ObjectPose.of(poses[0])
    return np.asarray(np.linalg.inv(poses)).repeat(counts, axis=0), None


def _joint_names(content: Sequence[Rows], joints: int) -> tuple[str, ...]:
    """The names of joints, if there are as many, the same in all. Raises ContactError."""
    named = {tuple(rows.get("joint_names", ())) for rows in content}
    if len(named) > 1:
        raise ContactError(
            "all its dictionaries must have the same joint_names: put the files of each hand into "
            "a folder of their own"
        )
    (names,) = named
    return names if len(names) == joints else ()


def _outcome(content: Sequence[Rows], counts: Sequence[int], given: Given) -> Floats:
    flags = [rows.get("succ_flag") for rows in content]
    values = [
        np.full(count, np.nan) if flag is None else np.resize(flag, count)
        for flag, count in zip(flags, counts, strict=True)
    ]
    known = ("succ_flag",) if any(flag is not None for flag in flags) else ()
    return outcomes_of(
        given.outcome, sum(counts), known, lambda _: np.concatenate(values), default=known
    )


def _names(content: Sequence[Rows], counts: Sequence[int]) -> tuple[str, ...]:
    """Names of grasps: those of their files in a folder, with numbers where these have many."""
    names = np.repeat([rows["name"] for rows in content], counts).tolist()
    together = Counter(names)
    numbers: dict[str, Iterator[int]] = defaultdict(lambda: naturals(1))
    if "" in together:
        return ()
    return tuple(name if together[name] == 1 else f"{name}_{next(numbers[name])}" for name in names)


def _object_file(content: Sequence[Rows]) -> str | None:
    files = {text for rows in content for text in rows.get("obj_path", ())}
    if len(files) > 1:
        raise ContactError(
            f"its grasps are of {len(files)} objects, such as {', '.join(sorted(files)[:2])}: put "
            "the files of each object into a folder of their own, and evaluate it with its mesh"
        )
    return next(iter(files), None)


def _elsewhere(content: Sequence[Rows]) -> dict[str, str]:
    """The frame of poses whose object's pose is in another file."""
    is_known = any("obj_pose" in rows for rows in content)
    at = next((rows["scene_path"][0] for rows in content if "scene_path" in rows), None)
    return {} if is_known or at is None else {"frame": f"of the scene {at}"}


def _of_one_scale(
    poses: GraspPoses, content: Sequence[Rows], counts: Sequence[int], wanted: float | None
) -> GraspPoses:
    """The grasps of the object at one scale, with this. Raises ContactError."""
    scales = np.full(poses.count, np.nan)
    starts = np.cumsum([0, *counts])
    for k, rows in enumerate(content):
        values = rows.get("obj_scale", rows.get("scale"))
        if values is not None:
            size = np.abs(values).max()
            if not (0.0 < values.min() <= size < np.inf and np.ptp(values) <= SAME * size):
                raise ContactError(
                    f"the scale of the object must be one number above 0; got {values}"
                )
            scales[starts[k] : starts[k + 1]] = values.reshape(-1)[0]
    known = np.unique(np.round(scales[np.isfinite(scales)], 9))
    if not len(known):
        return poses
    if wanted is None and len(known) > 1:
        raise ContactError(
            f"its grasps are of the object at {len(known)} scales, "
            f"{', '.join(f'{one:g}' for one in known[:8])}: choose one of them "
            "(--object-scale, in Python object_scale=...)"
        )
    scale = float(known[0]) if wanted is None else wanted
    chosen = np.flatnonzero(np.abs(scales - scale) <= SAME * scale)
    if not len(chosen):
        raise ContactError(
            f"it has no grasps of the object at the scale {scale:g}; known are "
            f"{', '.join(f'{one:g}' for one in known[:8])}"
        )
    some = poses if len(chosen) == poses.count else poses.take(chosen)
    return replace(some, object_scale=scale)


def write_bench(path: Path, poses: GraspPoses) -> None:
    """Write a dictionary with arrays of all grasps, of one grasp without a first axis."""
    rows = _stages(poses)
    one = poses.count == 1
    _save(path, {
        **{f"{stage}_qpos": values[0] if one else values for stage, values in rows.items()},
        **_object(poses),
    })  # fmt: skip


def write_net(path: Path, poses: GraspPoses) -> None:
    """Write a list of dictionaries, of the Shadow hand in the joints of DexGraspNet's model."""
    hand: Any = poses.hand
    names, moved = as_in_model(poses, hand)
    angles = Rotation.from_matrix(moved.poses[:, :3, :3]).as_euler("xyz")
    values = np.hstack([moved.poses[:, :3, 3], angles, moved.posture]).tolist()
    keys = (*TRANSLATION, *EULER, *names)
    scale = poses.object_scale
    _save(path, [{"qpos": dict(zip(keys, row, strict=True)), "scale": scale} for row in values])


def _stages(poses: GraspPoses) -> dict[str, Floats]:
    """Rows of a pose and the joints of the stages that are known, shape (k, 7 + p) each."""
    found = {"grasp": _qpos(poses.poses, poses.posture)}
    for stage in STAGES:
        posture, moved = getattr(poses, f"{stage}_posture"), getattr(poses, f"{stage}_poses")
        if posture.size:
            found[stage] = _qpos(poses.poses if moved is None else moved, posture)
    return {stage: found[stage] for stage in ALL_STAGES if stage in found}


def _qpos(poses: Floats, posture: Floats) -> Floats:
    return np.hstack([poses[:, :3, 3], np.roll(quaternions(poses), 1, axis=1), posture])


def _object(poses: GraspPoses) -> dict[str, Any]:
    at = np.eye(4) if poses.object_pose is None else poses.object_pose.matrix
    return {
        "obj_pose": _qpos(at[None], np.zeros((1, 0)))[0],
        "obj_scale": poses.object_scale,
        "obj_path": poses.object_file or "",
    }


def _save(path: Path, content: Any) -> None:
    values = np.array(content, dtype=object)
    with atomic_write(path) as part, part.open("wb") as stream:
        np.save(stream, values, allow_pickle=True)
