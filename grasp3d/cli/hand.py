"""The command `grasp3d hand`: prints the description of a hand, draws and writes it."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np

from grasp3d.cli.existing_files import check_output
from grasp3d.cli.report import Report, escaped
from grasp3d.cli.tool_commands import Hand
from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.plausible_numbers import implausible
from grasp3d.hand.articulated.presets import NAMES, content_of
from grasp3d.hand.hand import Hand as AnyHand
from grasp3d.hand.hand_files import read_hand, write_hand
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper, preset_names

GRIPPERS = ("name", "opening,\nmm", "fingers,\nmm", "force,\nN", "sensor\nresolution")
HANDS = ("hand with joints", "torques, N m", "couplings")
JOINTS = ("joint", "moves", "from,\n°", "to,\n°", "open,\n°", "closes", "torque,\nN m")
LINKS = ("link", "is", "shapes")

FRAME = (
    "the TCP, midway between the pads or tips; x: closing axis, from finger 1 to finger 2; "
    "z: approach direction; y = z x x"
)

NOT_STATED = "not stated"


def run(command: Hand) -> int:
    """Run the command, and return the exit code."""
    if not command.hand:
        if not command.quiet:
            print_known()
        return 0
    from grasp3d.plots.figures import METADATA, save_as

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
    if command.frames is not None and isinstance(hand, ParallelGripper):
        from grasp3d.plots.grippers import frames_figure

        save_as(frames_figure(hand), command.frames)
    if not command.quiet:
        print_hand(hand, *filter(None, (command.output, command.picture, command.frames)))
    return 0


def _draw(hand: AnyHand, path: Path) -> None:
    from grasp3d.plots.figures import save_as
    from grasp3d.plots.grippers import gripper_figure
    from grasp3d.plots.hands import hand_figure

    is_gripper = isinstance(hand, ParallelGripper)
    save_as(gripper_figure(hand) if is_gripper else hand_figure(hand), path)  # type: ignore[arg-type]


def print_known() -> None:
    """Print the grippers and the hands with joints that are known by name."""
    report, rows = Report(), []
    for title, gripper in zip(preset_names(), PRESETS.values(), strict=True):
        lengths = (gripper.finger_thickness, gripper.finger_width, gripper.finger_length)
        rows.append(
            (
                title,
                f"{_mm(gripper.min_opening)}–{_mm(gripper.max_opening)}",
                " x ".join(map(_mm, lengths)),
                "" if gripper.max_force is None else f"{gripper.max_force:g}",
                "" if gripper.resolution is None else _degrees(gripper.resolution),
            )
        )
    report.table(GRIPPERS, rows)
    report.line("fingers: thickness x width x length; grasp3d hand NAME prints all of a gripper\n")
    hands = []
    for name in NAMES:
        content = content_of(name)
        torques = (f"{torque:g}" for torque in sorted({*content.get("torques", {}).values()}))
        kinds = Counter(one["kind"] for one in content.get("couplings", ()))
        coupled = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        hands.append((name, ", ".join(torques) or NOT_STATED, coupled or "none"))
    report.table(HANDS, hands, texts=(0, 1, 2))
    report.line("they need a URDF of yours: grasp3d hand FILE.urdf -o NAME.json")


def print_hand(hand: AnyHand, *paths: Path) -> None:
    """Print the description of a gripper, or of a hand with joints.

    Args:
        hand: The hand.
        paths: Files that it was written to.
    """
    report = Report()
    if isinstance(hand, ArticulatedHand):
        units = "a hand with joints; angles in °, sliding in mm and N"
        report.line(f"[bold]{escaped(hand.name)}[/] ({units})")
        report.table(JOINTS, _joints(hand), texts=(0, 1))
        report.table(LINKS, _links(hand), texts=(0, 1, 2))
        report.values(_rows(hand))
        report.warnings(implausible(hand))
    elif isinstance(hand, ParallelGripper):
        report.line(f"[bold]{escaped(hand.name)}[/] (lengths in mm)")
        report.values(_fields(hand))
    if paths:
        report.written(*paths)


def _fields(gripper: ParallelGripper) -> Iterator[tuple[str, str]]:
    """Names and values of what is known of a gripper."""
    low, high = gripper.limits
    for one in fields(gripper):
        value = getattr(gripper, one.name)
        is_joint = one.name.startswith("joint_")
        if one.name in {"name", "sensor_resolution"} or value in {None, ()} or is_joint:
            continue
        text = str(value)
        if one.name == "max_force":
            text = f"{value:g} N"
        elif one.name == "inner_faces":
            text = str(len(value))
        elif isinstance(value, float):
            text = _mm(value)
        elif isinstance(value, tuple):
            text = ", ".join(value)
        yield one.name.replace("_", " "), text
    joints = gripper.joint_names, gripper.joint_closed, gripper.joint_scale
    for name, closed, scale in zip(*joints, strict=True):
        yield "joint", f"{name} = {closed:.6g} {scale:+.6g} x opening [m]"
    yield "opening of a grasp", f"{_mm(low)} to {_mm(high)}"
    yield "frame", FRAME
    alpha = gripper.resolution
    yield "sensor resolution", NOT_STATED if alpha is None else _degrees(alpha)
    if not gripper.round_tips:
        radius = gripper.torsion_radius(1.0)
        yield "torsion radius", f"{_mm(radius)} x friction, if the whole pads touch"


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


def _links(hand: ArticulatedHand) -> Iterator[list[str]]:
    for name, shapes in zip(hand.link_names, hand.shapes, strict=True):
        role = "fingertip" if name in hand.fingertips else "palm" if name == hand.palm else ""
        if shapes or role:
            counts = Counter(shape.kind for shape in shapes)
            text = ", ".join(f"{count} x {kind}" for kind, count in counts.items())
            yield [escaped(name), role, text]


def _rows(hand: ArticulatedHand) -> Iterator[tuple[str, str]]:
    """Names and values of what is known of a hand with joints."""
    x, y, z = np.round(hand.approach, 4) + 0.0  # without -0
    yield "frame", f"that of {hand.link_names[0]}, the base"
    yield "approach", f"({x:.4g}, {y:.4g}, {z:.4g}) in it, open"
    yield "preshapes", ", ".join(hand.preshapes)
    for name, alpha in hand.sensors.items():
        yield "sensor", f"{name} resolves {_degrees(alpha)}"
    for coupling in hand.couplings:
        pairs = zip(coupling.joints, coupling.ratios, strict=True)
        yield f"{coupling.kind} coupling", ", ".join(f"{name} : {ratio:g}" for name, ratio in pairs)
    if hand.tendons:
        yield "tendons", f"{', '.join(hand.tendons)}: it takes no load"
    if weights := [hand.masses[name].mass for name in hand.beyond_base if name in hand.masses]:
        yield "links", f"{sum(weights):.4g} kg that move"
    for joint in hand.tree.joints.values():
        if joint.follows is not None and all(joint.name not in c.joints for c in hand.couplings):
            name, factor, offset = joint.follows
            yield "follower", f"{joint.name} = {factor:g} x {name} {offset:+g}"
    yield "of", hand.tree.source
    if hand.source:
        yield "source", hand.source
    for sentence in hand.assumed:
        yield "assumed", sentence


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g}"


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}°"
