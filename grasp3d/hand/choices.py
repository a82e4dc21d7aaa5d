"""Choices about a hand and its object: axes, tables, whether the object moves."""

from typing import Literal

Standing = Literal["none", "as-is", "stable"]
"""What an object stands on: nothing, or a table, as it is or in a resting pose."""

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
AXES: dict[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0), "-y": (0.0, -1.0, 0.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip
"""Unit vectors of the axes of a frame, by name."""

ObjectMotion = Literal["free", "fixed"]
"""Whether an object gives way to closing fingers."""

ContactRule = Literal["given", "closed"]
"""How poses of hands with joints become contacts: as given, or by closing the hand from its open
preshape."""
