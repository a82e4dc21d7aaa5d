"""The command `grasp3d hand`: prints the description of a hand, draws and writes it."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

from grasp3d.cli.articulated import print_articulated, print_known
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.report import Report, escaped, table_of
from grasp3d.cli.tool_commands import Hand
from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.hand import Hand as AnyHand
from grasp3d.hand.hand_files import read_hand, write_hand
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper, preset_names

HEADINGS = ("name", "opening,\nmm", "fingers,\nmm", "pads,\nmm", "force,\nN", "sensor\nresolution")
"""Of the table of grippers that are known by name."""


def run(command: Hand) -> int:
    """Run the command, and return the exit code."""
    if not command.hand:
        if not command.quiet:
            print_presets()
            print_known()
        return 0
    from grasp3d.plots.figures import METADATA

    # The description that was read is replaced only with --overwrite.
    check_output(command.output, [".json"], "gripper", overwrite=command.overwrite)
    for path in (command.picture, command.frames):
        check_output(path, METADATA, "figure", overwrite=command.overwrite)
    hand = read_hand(
        command.hand, fingers=command.fingers, palm=command.palm, tcp=command.tcp,
        preset=command.preset,
    )  # fmt: skip
    if command.frames is not None and not isinstance(hand, ParallelGripper):
        raise SettingError(f"--frames is for parallel grippers; {hand.name!r} is none")
    if command.output is not None:
        write_hand(command.output, hand)
    if command.picture is not None:
        _draw(hand, command.picture)
    if command.frames is not None:
        from grasp3d.plots.figures import save_as
        from grasp3d.plots.grippers import frames_figure

        save_as(frames_figure(_gripper(hand)), command.frames)
    if not command.quiet:
        paths = filter(None, (command.output, command.picture, command.frames))
        if isinstance(hand, ArticulatedHand):
            print_articulated(hand, paths)
        else:
            print_gripper(_gripper(hand), paths)
    return 0


def _draw(hand: AnyHand, path: Path) -> None:
    from grasp3d.plots.figures import save_as

    if isinstance(hand, ArticulatedHand):
        from grasp3d.plots.hands import hand_figure

        save_as(hand_figure(hand), path)
    else:
        from grasp3d.plots.grippers import gripper_figure

        save_as(gripper_figure(_gripper(hand)), path)


def _gripper(hand: AnyHand) -> ParallelGripper:
    """A hand that is a parallel gripper. Raises SettingError."""
    if not isinstance(hand, ParallelGripper):
        raise SettingError(f"{hand.name!r} is of a kind that is not described")
    return hand


def print_presets() -> None:
    """Print the grippers that are known by name."""
    rows = (
        (
            title,
            f"{_mm(gripper.min_opening)}–{_mm(gripper.max_opening)}",
            _product(gripper.finger_thickness, gripper.finger_width, gripper.finger_length),
            _pads(gripper),
            "" if gripper.max_force is None else f"{gripper.max_force:g}",
            _resolution(gripper) or "",
        )
        for title, gripper in zip(preset_names(), PRESETS.values(), strict=True)
    )
    report = Report()
    report.table(table_of(HEADINGS, rows, folded=True))
    report.line("fingers: thickness x width x length; grasp3d hand NAME prints all of a gripper")


def print_gripper(gripper: ParallelGripper, paths: Iterable[Path] = ()) -> None:
    """Print the description of a gripper.

    Args:
        gripper: The gripper.
        paths: Files that it was written to.
    """
    report = Report()
    report.line(f"[bold]{escaped(gripper.name)}[/] (lengths in mm)")
    report.fields(_rows(gripper))
    for path in paths:
        report.written(path)


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
