"""Descriptions of hands with joints, in a folder beside the repository."""

from pathlib import Path

from tests.helpers.shapes import shared

HANDS = ("allegro", "leap", "shadow", "barrett")


def hand_file(name: str) -> Path:
    """The URDF of a hand; a test is skipped where it is not."""
    return shared("hands", name, f"{name}.urdf")
