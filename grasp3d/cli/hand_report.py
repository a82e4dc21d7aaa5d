"""Printed report of `grasp3d hand`."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper, preset_names
from grasp3d.system.names import printable


def print_presets() -> None:
    """Print the grippers that are known by name."""
    table = Table(box=None, pad_edge=False)
    table.add_column("name", no_wrap=True)
    for heading in ("opening,\nmm", "fingers,\nmm", "pads,\nmm", "force,\nN", "sensor\nresolution"):
        table.add_column(heading, justify="right", overflow="fold")
    for title, gripper in zip(preset_names(), PRESETS.values(), strict=True):
        table.add_row(
            title,
            f"{_mm(gripper.min_opening)}–{_mm(gripper.max_opening)}",
            _product(gripper.finger_thickness, gripper.finger_width, gripper.finger_length),
            _pads(gripper),
            "" if gripper.max_force is None else f"{gripper.max_force:g}",
            _resolution(gripper) or "",
        )
    console = Console(emoji=False)
    console.print(table)
    console.print(
        "fingers: thickness x width x length; grasp3d hand NAME prints all of a gripper",
        soft_wrap=True,
    )


def print_gripper(gripper: ParallelGripper, written: Sequence[Path] = ()) -> None:
    """Print the description of a gripper.

    Args:
        gripper: The gripper.
        written: Files that it was written to.
    """
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, text in _rows(gripper):
        table.add_row(name, escape(printable(text)))
    console = Console(emoji=False)
    console.print(f"[bold]{escape(printable(gripper.name))}[/] (lengths in mm)", soft_wrap=True)
    console.print(table)
    for path in written:
        console.print(f"written: {escape(printable(str(path)))}", soft_wrap=True)


def _rows(gripper: ParallelGripper) -> Iterator[tuple[str, str]]:
    """Names and values of a description."""
    low, high = gripper.limits
    yield "opening", f"{_mm(gripper.min_opening)} to {_mm(gripper.max_opening)}"
    clearance = f"{_mm(gripper.clearance)} on both sides"
    yield "  of a grasp", f"{_mm(low)} to {_mm(high)}, with a clearance of {clearance}"
    yield "fingers", f"{_mm(gripper.finger_thickness)} thick (x)"
    yield "", f"{_mm(gripper.finger_width)} wide (y)"
    yield "", f"{_mm(gripper.finger_length)} long (z)"
    if gripper.round_tips:
        yield "round tips", f"diameter {_mm(2.0 * gripper.tip_radius)}"
    else:
        yield "flat pads", f"{_mm(gripper.pad_width)} wide, {_mm(gripper.pad_height)} high"
    if gripper.inner_faces:
        depth = max(-corner[0] for face in gripper.inner_faces for corner in face)
        where = f"up to {_mm(depth)} behind the pads" if depth > 0.0 else "in the plane of the pads"
        yield "  inner faces", f"{len(gripper.inner_faces)}, {where}"
    yield "  give way by", _mm(gripper.compliance)
    yield "palm", f"{_mm(gripper.palm_thickness)} thick (x)"
    yield "", f"{_mm(gripper.palm_width)} wide (y)"
    yield "", f"{_mm(gripper.palm_length)} long (z)"
    yield from _frame_rows(gripper)
    yield from _touch_rows(gripper)
    if gripper.source:
        yield "source", gripper.source


def _frame_rows(gripper: ParallelGripper) -> Iterator[tuple[str, str]]:
    where = "centres of the tips" if gripper.round_tips else "centres of the pads"
    yield "frame", f"origin (TCP) midway between the {where}"
    yield "", "x: closing axis, from finger 1 to finger 2"
    yield "", "z: approach direction, from the palm to the object; y = z x x"
    closing, approach = gripper.base_axes
    yield "base to TCP", f"{_mm(gripper.base_to_tcp)} along z"
    yield "", f"x is {closing}, z is {approach} of the hand's own frame"
    for name, scale, closed in zip(
        gripper.joint_names, gripper.joint_scale, gripper.joint_closed, strict=True
    ):
        yield "joint", f"{name} = {closed:.6g} {scale:+.6g} x opening [m]"


def _touch_rows(gripper: ParallelGripper) -> Iterator[tuple[str, str]]:
    force = gripper.max_force
    yield "greatest force", "not stated" if force is None else f"{force:g} N"
    yield "sensor resolution", _resolution(gripper) or "not stated"
    if gripper.receptive_field is not None:
        yield "", f"from a receptive field of {_mm(gripper.receptive_field)}"
    if not gripper.round_tips:
        radius = gripper.torsion_radius(1.0)
        yield "torsion radius", f"{_mm(radius)} x friction, if the whole pads touch"


def _pads(gripper: ParallelGripper) -> str:
    if gripper.round_tips:
        return f"ball {_mm(2.0 * gripper.tip_radius)}"
    return _product(gripper.pad_width, gripper.pad_height)


def _product(*lengths: float) -> str:
    return " x ".join(map(_mm, lengths))


def _resolution(gripper: ParallelGripper) -> str | None:
    alpha = gripper.resolution
    return None if alpha is None else f"{math.degrees(alpha):.4g}°"


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g}"
