"""Printed report of evaluated poses of a hand with joints."""

import math
from pathlib import Path

import numpy as np

from grasp3d.cli.grasp_report import (
    number_text,
    outcomes_lines,
    print_files,
    print_some,
    reason_lines,
    resolution_text,
)
from grasp3d.cli.report import (
    LEVELS,
    PERCENTS,
    Column,
    Report,
    angle_text,
    escaped,
    label_name,
    model_words,
    percent_text,
)
from grasp3d.grasps.hand_grasps import EvaluatedHandGrasps
from grasp3d.grasps.hand_load_result import load_text
from grasp3d.grasps.ranking import ranked_rows
from grasp3d.settings.units import small_length
from grasp3d.stability.label import Label
from grasp3d.surface.area_statistics import quantiles
from grasp3d.system.counts import counted

_RULES = {
    "given": "contacts as given",
    "closed": "contacts closed from the open preshape",
}

_LEGEND = (
    "β*: critical friction angle; α*: coarsest resolution of all sensors; margin: friction angle "
    "to spare; gap: largest one of a link that touches, in mm (0: all are inside)"
)

_HELD = (
    "holds: what the motors hold at the perceived normals; surely: at the worst that the sensors "
    "cannot distinguish; limit: what limits that"
)

_LOAD = "; load: the mass over what is surely held"


def print_hand_grasps(grasps: EvaluatedHandGrasps, *outputs: Path) -> None:
    """Print the numbers of poses by label, gaps, depths and reasons, and the best poses.

    Args:
        grasps: Evaluated poses.
        outputs: The files that they were written to.
    """
    report, mesh, size = Report(), grasps.mesh, grasps.size
    distance = small_length(grasps.contact_distance, metres=True)
    report.heading(
        mesh.report.source,
        f"{counted(size, 'poses')} of hand {escaped(grasps.hand.name)}; "
        f"{model_words(grasps.model)}; {_RULES[grasps.contacts.rule]}, within {distance}",
    )

    def cells(label: Label) -> list[str]:
        count = int((grasps.label == label).sum())
        return [str(count), percent_text(count / size)]

    report.labels("scan", ("poses", "fraction"), cells)
    report.line(_lengths(grasps))
    report.lines(reason_lines(grasps))
    report.lines(outcomes_lines(grasps))
    report.line(f"[bold]{_verdict(grasps)}[/]")
    if grasps.hand_load_result is not None:
        report.line(f"[bold]{escaped(str(grasps.verdict))}[/]")
        report.line(escaped(grasps.hand_load_result.link_weights))
    report.warnings(grasps.warnings)
    print_some(report, _columns(grasps), grasps)
    report.line(_LEGEND)
    if grasps.hand_load_result is not None:
        report.line(f"{_HELD}{_LOAD}" if grasps.hand_load_result.load.decided else _HELD)
    print_files(report, grasps, *outputs)


def _lengths(grasps: EvaluatedHandGrasps) -> str:
    """How far links that touch are from the surface, and how deep links are in it."""
    texts = []
    for name, values in (("gap", grasps.gap), ("deepest penetration", grasps.penetration)):
        known = values[~np.isnan(values)]
        if len(known):
            levels = quantiles(known, LEVELS, np.ones(len(known)))
            lengths = (small_length(value, metres=True, digits=2) for value in levels)
            texts.append(f"{name} {', '.join(lengths)}")
    return f"{PERCENTS} of the poses: {'; '.join(texts)}"


def _verdict(grasps: EvaluatedHandGrasps) -> str:
    """How many poses are surely stable, and the best one."""
    sure, load = (grasps.label == Label.S) & grasps.reachable, grasps.to_hold
    held = "held" if load is not None and load.decided else "stable"
    text = f"surely {held} and reached: {int(sure.sum())} of {counted(grasps.size, 'poses')}"
    rows = ranked_rows(grasps)
    if not sure.any() or not len(rows):
        return text
    best = rows[0]
    name, margin = grasps.given.names[best], angle_text(grasps.margin[best])
    return f"{text}; the best is pose {best + 1} ({escaped(name)}), with a margin of {margin}"


def _columns(grasps: EvaluatedHandGrasps) -> list[Column]:
    """The columns of a table of poses."""

    def gap(row: int) -> str:
        return "none" if math.isnan(grasps.gap[row]) else f"{1e3 * grasps.gap[row]:.1f}"

    load_result = grasps.hand_load_result
    held: list[Column] = []
    if load_result is not None:
        unit = "kg" if load_result.load.by_mass else ""
        held = [
            (f"holds\n{unit}", lambda row: number_text(load_result.payload[row])),
            (f"surely\n{unit}", lambda row: number_text(load_result.payload_min[row])),
            ("limit", lambda row: escaped(str(load_result.limit[row]))),
        ]
        if load_result.load.decided:
            load: Column = ("load", lambda row: load_text(float(load_result.load_fraction[row])))
            held.insert(2, load)
    return [
        ("pose", lambda row: str(row + 1)),
        ("label", lambda row: label_name(Label(int(grasps.label[row])))),
        ("β*", lambda row: angle_text(grasps.critical_angle[row])),
        ("α*", lambda row: resolution_text(grasps.max_resolution[row])),
        ("margin", lambda row: angle_text(grasps.margin[row])),
        ("ε", lambda row: number_text(grasps.epsilon[row])),
        ("links", lambda row: str(len(grasps.links[row].split()))),
        ("gap", gap),
        *held,
        ("reason", lambda row: escaped(str(grasps.reason[row]))),
    ]
