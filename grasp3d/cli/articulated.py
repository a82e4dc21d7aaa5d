"""The description of a hand with joints, as `grasp3d hand` prints it."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from grasp3d.cli.report import Report, escaped, table_of
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.plausible_numbers import implausible
from grasp3d.hand.articulated.presets import NAMES, content_of

JOINTS = ("joint", "moves", "from,\n°", "to,\n°", "open,\n°", "closes", "torque,\nN m")
LINKS = ("link", "is", "shapes")
KNOWN = ("hand with joints", "torques", "couplings")

PLURALS = {"box": "boxes", "mesh": "meshes"}


def print_known() -> None:
    """Print the hands with joints that are known by name."""
    report = Report()
    rows = []
    for name in NAMES:
        content = content_of(name)
        torques = sorted({*content.get("torques", {}).values()})
        stated = ", ".join(f"{torque:g} N m" for torque in torques) or "not stated"
        kinds = Counter(one["kind"] for one in content.get("couplings", ()))
        coupled = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "none"
        rows.append([name, stated, coupled])
    report.line("")
    table = table_of(KNOWN, rows, texts=3)
    table.columns[1].no_wrap = True  # no spaces keep a unit with its number
    report.table(table)
    report.line("they need a URDF of yours: grasp3d hand FILE.urdf -o NAME.json")


def print_articulated(hand: ArticulatedHand, paths: Iterable[Path] = ()) -> None:
    """Print the description of a hand with joints.

    Args:
        hand: The hand.
        paths: Files that it was written to.
    """
    report = Report()
    report.line(
        f"[bold]{escaped(hand.name)}[/] (a hand with joints; angles in °, sliding in mm and N)"
    )
    report.table(table_of(JOINTS, _joints(hand), texts=2))
    report.table(table_of(LINKS, _links(hand), texts=3))
    report.fields(_rows(hand))
    report.warnings(implausible(hand))
    for path in paths:
        report.written(path)


def _joints(hand: ArticulatedHand) -> Iterator[list[str]]:
    moved = {joint.name: (link, joint) for link, joint in hand.tree.joints.items()}
    columns = hand.limits_of_joints, hand.preshapes["open"], hand.closing, hand.torques
    for name, limits, opened, speed, torque in zip(hand.joint_names, *columns, strict=True):
        link, joint = moved[name]
        unit = 1e3 if joint.kind == "slides" else math.degrees(1.0)
        numbers = [f"{unit * value:.4g}" for value in (*limits, opened)]
        closes = f"{speed:+g}" if speed else ""
        force = "not stated" if math.isnan(torque) else f"{torque:g}" if torque else "no motor"
        yield [escaped(name), escaped(link), *numbers, closes, force]


def _links(hand: ArticulatedHand) -> Iterator[list[str]]:
    for name, shapes in zip(hand.link_names, hand.shapes, strict=True):
        if not shapes and name not in {hand.palm, *hand.fingertips}:
            continue
        counts = Counter(shape.kind for shape in shapes)
        text = ", ".join(
            f"{count} {kind if count == 1 else PLURALS.get(kind, f'{kind}s')}"
            for kind, count in counts.items()
        )
        role = "fingertip" if name in hand.fingertips else "palm" if name == hand.palm else ""
        yield [escaped(name), role, text]


def _rows(hand: ArticulatedHand) -> Iterator[tuple[str, str]]:
    yield "frame", f"that of {hand.link_names[0]}, the base"
    x, y, z = np.round(hand.approach, 4) + 0.0  # without -0
    yield "approach", f"({x:.4g}, {y:.4g}, {z:.4g}) in it, open"
    yield "preshapes", ", ".join(hand.preshapes)
    yield from (
        ("sensor", f"{name} resolves {math.degrees(alpha):.4g}°")
        for name, alpha in hand.sensors.items()
    )
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
