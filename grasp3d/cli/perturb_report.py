"""Printed report of `grasp3d perturb`."""

import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from grasp3d.cli.report import CHECK_HINT, escaped, length_with_unit
from grasp3d.settings.lengths import Unit, small_length
from grasp3d.settings.model_text import error_texts, friction_text
from grasp3d.stability.label import COLORS, MEANING, Label
from grasp3d.system.counts import counted
from grasp3d.validating.perturbing.perturbation import Perturbation

MIN_STABLE = 0.01
"""Area fraction that is S below which errors to enter are of no use."""

NO_ADVICE = (
    "[yellow]no errors to enter:[/] with errors large enough for this noise hardly any of the area "
    "would be S; {}, or smooth the scan"
)
"""What is printed then, with a remedy."""

NOT_PASSED = (
    "[yellow]not all of this S is reliable:[/] `stable` in the file is the fraction of the copies "
    "that are S at each vertex; where it is low, the surface is too rough: {}"
)
"""What is printed where larger errors leave too little S, with a remedy."""


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
        f"size {length_with_unit(mesh.size, mesh.unit)}; friction {friction_text(model)}, "
        + ", ".join(
            [
                f"sensor resolution {math.degrees(model.sensor_resolution):.4g}°",
                *error_texts(model, mesh.unit),
                *([] if model.fingers == 2 else [f"{model.fingers} fingers"]),
            ]
        ),
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
        f"alike within {_length(settings.correlation, unit)}"
        if settings.correlation
        else "independent at every vertex"
    )
    return (
        f"noise of each of the {counted(settings.copies, 'copies')}: "
        f"{_length(settings.noise, unit)} along the normals ({origin}), {kind}"
    )


def _fractions(found: Perturbation) -> Table:
    """Area fractions of the labels of the surface itself, and of the copies."""
    table = Table("label", "", "scan", "noisy copies", box=None, pad_edge=False)
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
    where = " across the line between them" if found.labels.model.fingers == 2 else ""
    turn, shift = _angle(advice.measured_turn), _length(found.shift_across, unit)
    measured = (
        f"over {100.0 * level:g} % of the area and copies, normals turn by at most {turn} and "
        f"contacts shift by at most {shift}{where}"
    )
    if math.isnan(found.confirmed_fraction):
        return [measured]
    right = (
        f"{_percent(found.confirmed_fraction)} of the area that is S in a copy has a grasp that is "
        "S on the scan as well; the rest is S because of the noise"
    )
    return [measured, right]


def _advised(found: Perturbation) -> list[str]:
    """The errors to enter, and how they were checked."""
    advice, level = found.advice, 100.0 * found.settings.level
    if advice.stable_fraction < MIN_STABLE:
        return [NO_ADVICE.format(_remedy(found))]
    location = _length(advice.location_error, found.mesh.unit).replace(" ", "")
    words = f"--normal-error {math.degrees(advice.normal_error):.4g} --location-error {location}"
    stable, failing = map(_percent, (advice.stable_fraction, advice.unconfirmed_fraction))
    own = found.labels.model.normal_error
    contained = f" (they contain the {math.degrees(own):.4g}° given)" if own else ""
    checked = (
        f"with these errors{contained} {stable} of the area is S; {failing} of that is S in fewer "
        f"than {level:g} % of the copies"
    )
    lines = [f"[bold]enter: {words}[/]", checked]
    return lines if advice.passed else [*lines, NOT_PASSED.format(_remedy(found))]


def _remedy(found: Perturbation) -> str:
    """What makes the labels depend less on noise."""
    patch = found.mesh.options.patch_radius
    if patch:
        radius = _length(patch, found.mesh.unit)
        return f"average the normals over a patch larger than {radius} (--patch-radius)"
    return "average the normals over a patch of a few edge lengths (--patch-radius)"


def _length(length: float, unit: Unit | None) -> str:
    return small_length(length, unit, digits=3)


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.1f} %"


def _angle(angle: float) -> str:
    return "none" if math.isinf(angle) else f"{math.degrees(angle):.1f}°"
