"""Poses as JSON in the layout of the GraspGen data set."""

from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.errors import ContactError, OutputError
from grasp3d.grasps.pose_files.documents import (
    grasp_list,
    json_numbers,
    json_text,
    mapping,
    numbers,
    one_number,
    required,
    text_or_none,
)
from grasp3d.grasps.pose_files.frames import (
    for_robots,
    moved,
    needed_gripper,
)
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.hand import Hand
from grasp3d.settings.lengths import METRES, Unit
from grasp3d.system.files import atomic_write

WHAT = "GraspGen"

EXTRA = {"opening": "opening", "pregrasp_opening": "pregrasp_opening", "scores": "scores"}
"""Further lists, which only files of this project have."""


def is_graspgen(content: object) -> bool:
    """Whether the content of a JSON file is in this format."""
    grasps = content.get("grasps") if isinstance(content, dict) else None
    return isinstance(grasps, dict) and "transforms" in grasps


def write_graspgen(path: Path, poses: GraspPoses) -> None:
    """Write the poses of the hand's base and the outcomes, which all grasps must have."""
    hand, in_metres = for_robots(poses, WHAT)
    unknown = np.flatnonzero(np.isnan(in_metres.outcome))
    if len(unknown):
        raise OutputError(
            f"{WHAT} files state whether each grasp held; the outcome of grasp {unknown[0] + 1} is "
            "not known"
        )
    grasps = {
        "transforms": moved(in_metres.poses, -hand.base_to_tcp).tolist(),
        "object_in_gripper": (in_metres.outcome == 1.0).tolist(),
        "names": list(in_metres.names),
        **{
            key: json_numbers(getattr(in_metres, field))
            for field, key in EXTRA.items()
            if not np.isnan(getattr(in_metres, field)).all()
        },
    }
    scale = in_metres.object_scale or METRES[poses.unit or "m"]
    document = {"object": {"file": in_metres.object_file or "", "scale": scale}, "grasps": grasps}
    with atomic_write(path) as part:
        part.write_text(json_text(document), encoding="utf-8")


def parse_graspgen(content: object, hand: Hand | None, unit: Unit | None) -> GraspPoses:
    """Poses of the content of a JSON file. Raises ContactError."""
    document = mapping(content, "the file")
    grasps = mapping(required(document, "grasps"), "grasps")
    transforms = grasp_list(required(grasps, "transforms", "grasps: "), "grasps.transforms")
    about = mapping(document.get("object", {}), "object")
    hand = needed_gripper(hand, unit, WHAT)
    count = len(transforms)
    scale = about.get("scale")
    fields = {"outcome": "object_in_gripper", **EXTRA}
    names = grasps.get("names")
    quantities: dict[str, Any] = {
        field: numbers(_as_many(grasps[key], key, count), (), key)
        for field, key in fields.items()
        if grasps.get(key) is not None
    }
    return GraspPoses(
        poses=moved(numbers(transforms, (4, 4), "transforms"), hand.base_to_tcp),
        names=tuple(map(str, grasp_list(names, "grasps.names"))) if names is not None else (),
        unit="m",
        hand=hand,
        object_file=text_or_none(about.get("file"), "object.file") or None,
        object_scale=None if scale is None else one_number(scale, "object.scale"),
        **quantities,
    )


def _as_many(values: object, key: str, count: int) -> list[object]:
    """A list of as many values as there are grasps; lists of one value are that value."""
    entries = grasp_list(values, f"grasps.{key}")
    if len(entries) != count:
        raise ContactError(f"grasps.{key} must have {count} values, one of each grasp")
    return [value[0] if isinstance(value, list) and len(value) == 1 else value for value in entries]
