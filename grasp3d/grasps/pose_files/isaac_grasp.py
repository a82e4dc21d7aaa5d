"""Poses as `isaac_grasp` YAML, format version 1.0."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.grasps.pose_files.documents import (
    each,
    json_numbers,
    kind,
    mapping,
    numbers,
    one_number,
    optional_numbers,
    required,
    text_or_none,
)
from grasp3d.grasps.pose_files.frames import (
    for_robots,
    from_quaternions,
    hand_poses,
    joint_values,
    needed_gripper,
    openings_of_joints,
    quaternions,
    tcp_poses,
    unequal_names,
)
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.hand import Hand
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.settings.lengths import METRES, Unit
from grasp3d.system.files import atomic_write
from grasp3d.system.versions import package_version

WHAT = "isaac_grasp"
VERSION = 1.0

DEEPEST = 32
"""Deepest nesting that is read: libyaml's constructor overflows the stack at some thousands."""

_PYTHON = "tag:yaml.org,2002:python"


def write_isaac(path: Path, poses: GraspPoses) -> None:
    """Write grasps by name, the hand's base relative to the object."""
    yaml = _yaml()
    hand, in_metres = for_robots(poses, WHAT)
    unequal_names(in_metres.names)
    document = {
        "format": WHAT,
        "format_version": VERSION,
        "object_frame_link": str(in_metres.settings.get("object_frame_link", "object")),
        "gripper_frame_link": str(in_metres.settings.get("gripper_frame_link", hand.name)),
        "object_scale": in_metres.object_scale or METRES[poses.unit or "m"],
        "grasps": dict(zip(in_metres.names, _entries(in_metres, hand), strict=True)),
    }
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.write(f"# written by grasp3d {package_version()}\n")
        yaml.dump(
            document, stream, dumper, sort_keys=False, default_flow_style=None, allow_unicode=True
        )


def _entries(poses: GraspPoses, hand: ParallelGripper) -> list[dict[str, Any]]:
    outside = np.flatnonzero((poses.scores < 0.0) | (poses.scores > 1.0))
    if len(outside):
        raise OutputError(
            f"the confidence in {WHAT} files must be from 0 to 1; grasp {outside[0] + 1} has "
            f"{poses.scores[outside[0]]:g}"
        )
    bases = hand_poses(poses.poses, hand)
    turned = quaternions(bases).tolist()
    closed = _joints(hand, poses.opening)
    opened = _joints(hand, poses.pregrasp_opening)
    return [
        {
            "confidence": float(poses.scores[k]),
            "position": bases[k, :3, 3].tolist(),
            "orientation": {"w": turned[k][3], "xyz": turned[k][:3]},
            "cspace_position": closed[k],
            "pregrasp_cspace_position": opened[k],
        }
        for k in range(poses.count)
    ]


def _joints(hand: ParallelGripper, openings: Floats) -> list[dict[str, float]]:
    """Joint values by name; empty where the opening is not known."""
    rows = json_numbers(joint_values(hand, openings, WHAT))
    return [
        {n: v for n, v in zip(hand.joint_names, row, strict=True) if v is not None} for row in rows
    ]


def read_isaac(path: Path, hand: Hand | None, unit: Unit | None) -> GraspPoses:
    """Grasps in the order of the file. Raises ContactError, OSError."""
    document = mapping(load_yaml(path), "the file")
    if required(document, "format") != WHAT:
        raise ContactError(f"format must be {WHAT}; got {kind(document['format'])}")
    version = one_number(document.get("format_version", VERSION), "format_version")
    if int(version) != int(VERSION):
        raise ContactError(f"format_version must be {VERSION}; got {version:g}")
    grasps = mapping(required(document, "grasps"), "grasps")
    if not grasps:
        raise ContactError("there are no grasps in it")
    hand = needed_gripper(hand, unit, WHAT)
    entries = [mapping(entry, f"grasp {number}") for number, entry in enumerate(grasps.values(), 1)]
    scale = document.get("object_scale")
    return GraspPoses(
        poses=tcp_poses(_bases(entries), hand),
        opening=openings_of_joints(hand, _stated_joints(entries, "cspace_position")),
        pregrasp_opening=openings_of_joints(
            hand, _stated_joints(entries, "pregrasp_cspace_position")
        ),
        scores=optional_numbers(entries, "confidence"),
        names=tuple(map(str, grasps)),
        unit="m",
        hand=hand,
        object_file=text_or_none(document.get("object_file"), "object_file"),
        object_scale=None if scale is None else one_number(scale, "object_scale"),
        settings=_frames(document),
    )


def _bases(entries: list[dict[str, Any]]) -> Floats:
    """Poses of the hand's base, shape (k, 4, 4)."""
    for number, entry in enumerate(entries, 1):
        if isinstance(entry.get("orientation"), list):
            raise ContactError(
                f"grasp {number}: orientation must be w and xyz: a list of numbers does not state "
                "whether w is the first or the last"
            )
    positions = numbers(each(entries, "position"), (3,), "position")
    w = numbers(each(entries, "orientation", "w"), (), "orientation.w")
    xyz = numbers(each(entries, "orientation", "xyz"), (3,), "orientation.xyz")
    return from_quaternions(positions, np.column_stack([xyz, w]))


def _stated_joints(entries: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    return [
        mapping({} if entry.get(key) is None else entry[key], f"grasp {number}: {key}")
        for number, entry in enumerate(entries, 1)
    ]


def _frames(document: dict[str, Any]) -> dict[str, str]:
    """Names of the frames; the editor calls them ..._link, other programs do not."""
    names: dict[str, str] = {}
    for key in ("object_frame_link", "gripper_frame_link"):
        value = document.get(key, document.get(key.removesuffix("_link")))
        if isinstance(value, str):
            names[key] = value
    return names


def load_yaml(path: Path) -> Any:
    """Content of a YAML file of plain values. Raises ContactError, OSError."""
    yaml = _yaml()
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    text = path.read_bytes()
    try:
        _check_events(yaml, text, loader)
        return yaml.load(text, loader)
    except yaml.YAMLError as error:
        raise ContactError(f"is no YAML: {' '.join(str(error).split())[:200]}") from error
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        # Dates such as 2026-13-45, numbers of thousands of digits, keys that are lists.
        raise ContactError(f"is no YAML: {error}") from error


def _check_events(yaml: Any, text: bytes, loader: Any) -> None:
    """Refuse what a small file can expand to any size, and objects of Python."""
    depth = 0
    for event in yaml.parse(text, loader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise ContactError(f"it is nested more than {DEEPEST} levels deep")
        if str(getattr(event, "tag", None)).startswith(_PYTHON):
            raise ContactError("it contains objects of Python, which are not read: plain YAML only")
        if getattr(event, "value", None) == "<<":
            raise ContactError("it merges keys (<<), which is not read: write the keys out")


def _yaml() -> Any:
    if find_spec("yaml") is None:
        raise OutputError("YAML needs PyYAML: pip install 'grasp3d[datasets]'")
    import yaml

    return yaml
