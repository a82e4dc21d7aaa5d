"""Descriptions of hands with joints, in a folder beside the repository."""

import math
from pathlib import Path

from tests.helpers.shapes import shared

HANDS = ("allegro", "leap", "shadow", "barrett")


def hand_file(name: str) -> Path:
    """The URDF of a hand; the test is skipped if the file is missing."""
    return shared("hands", name, f"{name}.urdf")


FINGER = """
 <link name="inner{n}"><collision><origin xyz="0 0 0.02"/><geometry>{shape}</geometry></collision>
 </link>
 <link name="outer{n}"><collision><origin xyz="0 0 0.015"/>
  <geometry><box size="0.01 0.01 0.03"/></geometry></collision></link>
 <joint name="knuckle{n}" type="{kind}"><parent link="palm"/><child link="inner{n}"/>
  <origin xyz="{x} {y} 0.01" rpy="0 0 {yaw}"/><axis xyz="0 1 0"/>
  <limit lower="-1.2" upper="0.3" effort="{effort}"/></joint>
 <joint name="bend{n}" type="revolute"><parent link="inner{n}"/><child link="outer{n}"/>
  <origin xyz="0 0 0.04"/><axis xyz="0 1 0"/>
  <limit lower="-1.5" upper="0" effort="{effort}"/></joint>"""


def three_fingers(
    folder: Path,
    *,
    effort: float = 0.5,
    kind: str = "revolute",
    shape: str = '<box size="0.01 0.01 0.04"/>',
    more: str = "",
) -> Path:
    """Write the URDF of a hand of three fingers, with two joints each, about a flat palm."""
    fingers = [
        FINGER.format(
            n=n, x=0.04 * math.cos(yaw), y=0.04 * math.sin(yaw), yaw=yaw, shape=shape,
            kind=kind if n == 0 else "revolute", effort=effort,
        )
        for n, yaw in enumerate(2.0 * math.pi * k / 3.0 for k in range(3))
    ]  # fmt: skip
    path = folder / "three.urdf"
    palm = '<collision><geometry><box size="0.1 0.1 0.02"/></geometry></collision>'
    path.write_text(
        f'<robot name="three"><link name="palm">{palm}</link>{"".join(fingers)}{more}</robot>',
        encoding="utf-8",
    )
    return path
