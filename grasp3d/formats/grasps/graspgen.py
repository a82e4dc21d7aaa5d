"""JSON of GraspGen: transforms, and whether each grasp held.

| key | |
|---|---|
| `object.file` `object.scale` | as in [ACRONYM](#acronym) |
| `grasps.transforms` | poses of the hand, x closing, 4×4 each |
| `grasps.object_in_gripper` | list of true and false. Every outcome must be known: grasps that were not tried cannot be written in this format |
"""

import json
from pathlib import Path
from typing import Any

from grasp3d.errors import ContactError
from grasp3d.formats import checks
from grasp3d.formats.checks import outcomes_of
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import GraspPoses

OUTCOME = "object_in_gripper"


def write(path: Path, poses: GraspPoses) -> None:
    """Write the poses of the hand's base and the outcomes."""
    about = {"file": poses.object_file or "", "scale": poses.object_scale}
    held = (poses.outcome == 1.0).tolist()
    grasps = {"transforms": poses.poses.tolist(), OUTCOME: held}
    checks.write_text(path, [json.dumps({"object": about, "grasps": grasps})])


def read(content: Any, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file. Raises ContactError."""
    grasps, about = (checks.mapping(content.get(key, {}), key) for key in ("grasps", "object"))
    transforms = checks.grasp_list(grasps["transforms"], "grasps.transforms")

    def of_each(key: str) -> list[Any]:
        """One value for each grasp; files may wrap each value in a list."""
        values = checks.grasp_list(grasps[key], f"grasps.{key}")
        if len(values) != len(transforms):
            raise ContactError(f"grasps.{key} must have {len(transforms)} values, one of each")
        return [one[0] if isinstance(one, list) and len(one) == 1 else one for one in values]

    stated = [key for key, values in grasps.items() if values is not None and key != "transforms"]
    return GraspPoses(
        poses=checks.numbers(transforms, (4, 4), "transforms"),
        outcome=outcomes_of(given.outcome, len(transforms), stated, of_each, default=(OUTCOME,)),
        object_file=checks.text_or_none(about.get("file"), "object.file") or None,
        object_scale=checks.number_or_none(about.get("scale"), "object.scale"),
    )


register(Format(
    name="graspgen", title="GraspGen", suffixes=(".json",), frame="graspgen", outcomes=True,
    sniff=checks.has("grasps.transforms"), read=read, write=write,
    holds="the key grasps with transforms", about=__doc__ or "",
))  # fmt: skip
