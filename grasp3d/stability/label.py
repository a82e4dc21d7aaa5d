"""Labels S, M and U of grasps, their colours and meanings."""

from collections.abc import Iterable
from enum import IntEnum
from typing import Literal


class Label(IntEnum):
    """Reliability of a grasp, in ascending order; the letters are those of Wan & Howe 2018."""

    U = 0
    """Surely unstable; on a labelled surface: no grasp found."""
    M = 1
    """Ambiguous: stable at some normals within the sensor's resolution, unstable at others."""
    S = 2
    """Surely stable: whatever the true normals within the sensor's resolution."""


COLORS: dict[Label, tuple[int, int, int]] = {
    Label.U: (0xD5, 0x5E, 0x00),
    Label.M: (0xF0, 0xE4, 0x42),
    Label.S: (0x00, 0x9E, 0x73),
}
"""Red, green, blue (0-255); colour-blind readers can distinguish them as well."""


def hex_color(color: Iterable[int]) -> str:
    """Red, green and blue (0-255) as #RRGGBB."""
    return "#{:02X}{:02X}{:02X}".format(*color)


GREY = (0x9A, 0xA0, 0xA6)
"""Grey: where no contact may be, and what is not known."""

Mode = Literal["label", "scan"]
"""Whether the grasps on a surface were searched for, or are given, as in a scan."""

_IN_BOTH_MODES = {Label.S: "surely stable", Label.M: "ambiguous"}
MEANING: dict[Mode, dict[Label, str]] = {
    "label": {**_IN_BOTH_MODES, Label.U: "no grasp found"},
    "scan": {**_IN_BOTH_MODES, Label.U: "surely unstable"},
}
"""Meaning of each label in either mode, as shown to users."""
