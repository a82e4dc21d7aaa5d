"""Labels of grasps: S, M and U, their colours and meanings."""

from enum import IntEnum
from typing import Literal


class Label(IntEnum):
    """How reliable a grasp is, ordered; the letters are those of Wan & Howe 2018."""

    U = 0
    """Surely unstable; on a labelled surface: no grasp found."""
    M = 1
    """The sensor cannot tell."""
    S = 2
    """Surely stable: whatever the true normals within the sensor's resolution."""


COLORS: dict[Label, tuple[int, int, int]] = {
    Label.U: (0xD5, 0x5E, 0x00),
    Label.M: (0xF0, 0xE4, 0x42),
    Label.S: (0x00, 0x9E, 0x73),
}
"""Red, green, blue (0-255); told apart by colour-blind readers as well."""

Mode = Literal["label", "scan"]
"""Whether the grasps on a surface were searched, or are given, as in a scan."""

_EITHER = {Label.S: "surely stable", Label.M: "the sensor cannot tell"}
MEANING: dict[Mode, dict[Label, str]] = {
    "label": {**_EITHER, Label.U: "no grasp found"},
    "scan": {**_EITHER, Label.U: "surely unstable"},
}
"""What a label says in either mode, for those who read it."""
