"""The command `grasp3d hand`: prints, draws and writes the description of a hand."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from grasp3d.cli.commands import Hand
from grasp3d.cli.report import Report, escaped
from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.hand import Hand as AnyHand
from grasp3d.hand.hand_files import read_hand, write_hand
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper, preset_names
from grasp3d.hand.proposal import implausible
from grasp3d.hand.robot_files import NAMES

GRIPPERS = ("name", "opening,\nmm", "force,\nN")
JOINTS = ("joint", "moves", "from,\n°", "to,\n°", "open,\n°", "closes", "torque,\nN m")

FRAME = "the TCP, midway between pads or tips; x: closing axis, to finger 2; z: approach direction"

NOT_STATED = "not stated"
OTHER_NUMBERS = {"max_force", "sensor_resolution"}
"""Numbers of a gripper that are not lengths."""


def run(command: Hand, report: Report) -> int:
    """Run the command, and return the exit code."""
    if not command.hand:
        print_known(report)
        return 0
    from grasp3d.pictures.figures import METADATA, save_as
    from grasp3d.pictures.hands import frames_figure, gripper_figure, hand_figure

    # The description that was read is only replaced with --overwrite.
    command.check_output(command.output, [".json"], "gripper")
    for path in (command.picture, command.frames):
        command.check_output(path, METADATA, "figure")
    fingers: Any = command.fingers or None  # two fingers; other numbers are refused
    hand = read_hand(command.hand, fingers=fingers, palm=command.palm, tcp=command.tcp)
    if command.frames is not None:
        if not isinstance(hand, ParallelGripper):
            raise SettingError(f"--frames is for parallel grippers; {hand.name!r} is none")
        save_as(frames_figure(hand), command.frames)
    if command.output is not None:
        write_hand(command.output, hand)
    if command.picture is not None:
        draw: Any = gripper_figure if isinstance(hand, ParallelGripper) else hand_figure
        save_as(draw(hand), command.picture)
    print_hand(report, hand)
    if written := [*filter(None, (command.output, command.picture, command.frames))]:
        report.written(*written)
    return 0


def print_known(report: Report) -> None:
    """Print the grippers and hands with joints that are known by name."""
    rows = (
        (title, f"{_mm(one.min_opening)}–{_mm(one.max_opening)}", f"{one.max_force or 0.0:g}")
        for title, one in zip(preset_names(), PRESETS.values(), strict=True)
    )
    report.table(GRIPPERS, rows)
    report.line(f"hands with joints: {', '.join(NAMES)}")
    report.line("they need a URDF of yours: grasp3d hand FILE.urdf -o NAME.json")


def print_hand(report: Report, hand: AnyHand) -> None:
    """Print the description of a gripper, or of a hand with joints.

    Args:
        report: Where to print.
        hand: The hand.
    """
    if isinstance(hand, ArticulatedHand):
        report.heading(hand.name, "a hand with joints; angles in °, sliding in mm and N")
        report.table(JOINTS, _joints(hand), texts=(0, 1))
        report.values(_rows(hand))
        report.warnings(implausible(hand))
    elif isinstance(hand, ParallelGripper):
        report.heading(hand.name, "lengths in mm")
        report.values(_fields(hand))


def _fields(gripper: ParallelGripper) -> Iterator[tuple[str, str]]:
    """Yield names and values of a gripper's known properties."""
    for name, value in gripper.description().items():
        if isinstance(value, float) and name not in OTHER_NUMBERS:
            yield name.replace("_", " "), _mm(value)
    yield "base axes", ", ".join(gripper.base_axes)
    joints = gripper.joint_names, gripper.joint_closed, gripper.joint_scale
    for name, closed, scale in zip(*joints, strict=True):
        yield "joint", f"{name} = {closed:.6g} {scale:+.6g} x opening [m]"
    yield "opening of a grasp", " to ".join(map(_mm, gripper.limits))
    yield "max force", NOT_STATED if gripper.max_force is None else f"{gripper.max_force:g} N"
    alpha = gripper.sensor_resolution
    yield "sensor resolution", NOT_STATED if alpha is None else f"{math.degrees(alpha):.4g}°"
    yield "frame", FRAME
    source, _, assumed = gripper.source.partition("; assumed: ")
    yield "source", source or NOT_STATED
    yield from (("assumed", sentence) for sentence in assumed.split("; ") if sentence)


def _joints(hand: ArticulatedHand) -> Iterator[list[str]]:
    moved = {joint.name: (link, joint) for link, joint in hand.tree.joints.items()}
    columns = hand.limits_of_joints, hand.preshapes["open"], hand.closing, hand.torques
    for name, limits, opened, speed, torque in zip(hand.joint_names, *columns, strict=True):
        link, joint = moved[name]
        unit = 1e3 if joint.kind == "slides" else math.degrees(1.0)
        numbers = [f"{unit * value + 0.0:.4g}" for value in (*limits, opened)]
        closes = f"{speed:+g}" if speed else ""
        force = NOT_STATED if math.isnan(torque) else f"{torque:g}" if torque else "no motor"
        yield [escaped(name), escaped(link), *numbers, closes, force]


def _rows(hand: ArticulatedHand) -> Iterator[tuple[str, str]]:
    """Yield names and values of the known properties of a hand with joints."""
    x, y, z = np.round(hand.approach, 4) + 0.0  # without -0
    yield "frame", f"that of {hand.link_names[0]}, the base"
    yield "palm", hand.palm
    yield "fingertips", ", ".join(hand.fingertips)
    yield "approach", f"({x:.4g}, {y:.4g}, {z:.4g}) in it, open"
    yield "preshapes", ", ".join(hand.preshapes)
    for name, alpha in hand.sensors.items():
        yield "sensor", f"{name} resolves {math.degrees(alpha):.4g}°"
    for coupling in hand.couplings:
        pairs = zip(coupling.joints, coupling.ratios, strict=True)
        yield "coupling", ", ".join(f"{name} : {ratio:g}" for name, ratio in pairs)
    yield "of", hand.tree.source
    yield "source", hand.source or NOT_STATED
    for sentence in hand.assumed:
        yield "assumed", sentence


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g}"
