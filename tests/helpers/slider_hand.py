"""A hand of sliding fingers around its axis z, whose grasps have known answers.

Each finger is a ball of 1 cm radius at `REACH` from the axis, which a joint moves inward. The palm
is a thin plate below.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.mujoco_model import read_links
from grasp3d.hand.proposal import articulated_hand_of
from grasp3d.hand.robot_files import FORMAT, VERSION

Floats = NDArray[np.float64]

REACH, TIP = 0.08, 0.01
"""Distance of the balls' centres from the axis at joint value 0, and their radius [m]."""

BOX = (0.06, 0.06, 0.04)
"""Sides of a box [m]; four fingers touch it in the middle of its faces at `TOUCHING`."""

TOUCHING = REACH - TIP - BOX[0] / 2.0
"""Joint value at which the fingers touch the box [m]."""

_LINK = (
    '<link name="{0}"><collision><origin xyz="0 0 {1}"/><geometry>{2}</geometry></collision></link>'
)
_JOINT = (
    '<joint name="slide_{0}" type="prismatic"><parent link="palm"/><child link="finger_{0}"/>'
    '<origin xyz="{1} {2} 0"/><axis xyz="{3} {4} 0"/>'
    '<limit lower="0" upper="0.06" effort="20" velocity="1"/></joint>'
)


def write(folder: Path, fingers: int = 4, **stated: Any) -> Path:
    """Write the URDF and the description of the hand; return the path of the latter."""
    plate = '<box size="0.05 0.05 0.004"/>'
    parts = [_LINK.format("palm", -0.06, plate)]
    for number in range(fingers):
        angle = 2.0 * math.pi * number / fingers
        x, y = math.cos(angle), math.sin(angle)
        parts.append(_LINK.format(f"finger_{number}", 0.0, f'<sphere radius="{TIP}"/>'))
        parts.append(_JOINT.format(number, REACH * x, REACH * y, -x, -y))
    text = f'<robot name="sliders">{"".join(parts)}</robot>'
    (folder / "sliders.urdf").write_text(text, encoding="utf-8")
    content = {
        "format": FORMAT, "version": VERSION, "description": "sliders.urdf", "palm": "palm",
        "approach": [0, 0, 1], "fingertips": [f"finger_{number}" for number in range(fingers)],
        **stated,
    }  # fmt: skip
    path = folder / "sliders.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def hand(folder: Path, fingers: int = 4, **stated: Any) -> ArticulatedHand:
    """The hand."""
    path = write(folder, fingers, **stated)
    known = json.loads(path.read_text(encoding="utf-8"))
    for key in ("format", "version", "description"):
        del known[key]
    return articulated_hand_of(read_links(folder / "sliders.urdf"), known)
