"""Printed report of `grasp3d perturb`."""

import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from grasp3d.cli.report import CHECK_HINT, escaped, length_with_unit
from grasp3d.lengths import METRES, Unit
from grasp3d.perturbing.perturbation import Perturbation
from grasp3d.stability.label import COLORS, MEANING, Label
from grasp3d.system.counts import counted

MIN_STABLE = 0.01
"""Area fraction that is S below which errors to enter are of no use."""

NO_ADVICE = (
    "[yellow]no errors to enter:[/] hardly anything would be S in {:g} % of the copies; average "
    "the normals over a patch of some edge lengths (--patch-radius), or smooth the scan"
)
"""What is printed then."""

NOT_PASSED = (
    "[yellow]not all of it is reliable:[/] some part of the surface is too rough, see `stable` in "
    "the file; a wider patch helps (--patch-radius)"
)
"""What is printed where larger errors leave too little S."""


def print_perturbation(found: Perturbation, written: Sequence[Path]) -> None:
    """Print the noise, area fractions with and without it, and the errors to enter.

    Args:
        found: Results of the copies.
        written: The files that they were written to.
    """
    console = Console(emoji=False)
    mesh, model = found.mesh, found.labels.model
    console.print(
        f"[bold]{escaped(mesh.report.source)}[/]: {counted(len(mesh.vertices), 'vertices')}, "
        f"size {length_with_unit(mesh.size, mesh.unit)}; friction {model.friction:g}, "
        f"sensor resolution {math.degrees(model.sensor_resolution):.4g}°"
        + ("" if model.fingers == 2 else f", {model.fingers} fingers"),
        soft_wrap=True,
    )
    console.print(_noise(found), soft_wrap=True)
    console.print(_fractions(found))
    for line in (*_measured(found), *_advised(found)):
        console.print(line, soft_wrap=True)
    for line in found.labels.warnings:
        console.print(f"[yellow]warning:[/] {escaped(line)}", soft_wrap=True)
    if mesh.report.warnings:
        console.print(CHECK_HINT)
    console.print("written: " + escaped(", ".join(map(str, written))), soft_wrap=True)


def _noise(found: Perturbation) -> str:
    settings, unit = found.settings, found.mesh.unit
    assert settings.noise is not None  # it is a number in results
    origin = "estimated from the surface's roughness" if found.estimated else "as given"
    kind = (
        f"alike within {short_length(settings.correlation, unit)}"
        if settings.correlation
        else "white"
    )
    return (
        f"noise: {short_length(settings.noise, unit)} along the normals, {origin}, {kind}; "
        f"{counted(settings.copies, 'copies')}"
    )


def _fractions(found: Perturbation) -> Table:
    """Area fractions of the labels of the surface itself, and of the copies."""
    table = Table("label", "", "this surface", "its copies", box=None, pad_edge=False)
    for column in table.columns[2:]:
        column.justify = "right"
    areas = found.mesh.vertex_areas / found.mesh.vertex_areas.sum()
    parts = {Label.S: found.stable, Label.M: found.ambiguous, Label.U: found.unstable}
    own = found.labels.fractions()
    for label, part in parts.items():
        color = "#{:02X}{:02X}{:02X}".format(*COLORS[label])
        table.add_row(
            f"[{color}]■[/] {label.name}",
            MEANING["label"][label],
            _percent(own[label.name]),
            _percent(float((areas * part).sum())),
        )
    return table


def _measured(found: Perturbation) -> list[str]:
    """What noise does to normals, contacts and grasps."""
    advice, unit, level = found.advice, found.mesh.unit, found.settings.level
    where = "across their line " if found.labels.model.fingers == 2 else ""
    turn, shift = _angle(advice.measured_turn), short_length(found.shift_across, unit)
    covered = f"({100.0 * level:g} % of area and copies)"
    lines = [f"within {turn} normals turn, within {shift} contacts shift {where}{covered}"]
    if not math.isnan(found.confirmed_fraction):
        lines.append(
            f"of what is S in a copy, {_percent(found.confirmed_fraction)} of the area have a "
            "grasp that is S on this surface"
        )
    return lines


def _advised(found: Perturbation) -> list[str]:
    """The errors to enter, and how they were checked."""
    advice, level = found.advice, 100.0 * found.settings.level
    if advice.stable_fraction < MIN_STABLE:
        return [NO_ADVICE.format(level)]
    location = short_length(advice.location_error, found.mesh.unit).replace(" ", "")
    words = f"--normal-error {math.degrees(advice.normal_error):.4g} --location-error {location}"
    stable, failing = map(_percent, (advice.stable_fraction, advice.unconfirmed_fraction))
    lines = [
        f"[bold]enter: {words}[/]",
        f"with these {stable} of the area are S; {failing} of it in under {level:g} % of copies",
    ]
    return lines if advice.passed else [*lines, NOT_PASSED]


def short_length(length: float, unit: Unit | None) -> str:
    """Format a small length: in millimetres if the mesh's unit is metric, else in that unit."""
    if unit is None or unit == "in":
        return f"{length:.3g}" + (f" {unit}" if unit else "")
    return f"{1000.0 * METRES[unit] * length:.3g} mm"


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.1f} %"


def _angle(angle: float) -> str:
    return "none" if math.isinf(angle) else f"{math.degrees(angle):.1f}°"
