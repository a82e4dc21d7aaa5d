"""The command `grasp3d perturb`: labels noisy copies of a scan."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grasp3d.cli import progress_bars
from grasp3d.cli.commands import Perturb
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.options import given_sampling
from grasp3d.cli.report import CHECK_HINT, Report, angle_text, model_words, percent_text
from grasp3d.mesh.noisy_copies import movable_surface
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.plots.figures import METADATA, save_as
from grasp3d.plots.perturbations import perturbation_figure
from grasp3d.rendering.opengl import check_rendering
from grasp3d.settings.lengths import Unit, small_length
from grasp3d.settings.model_text import error_texts
from grasp3d.system.counts import counted
from grasp3d.system.names import safe_stem
from grasp3d.validating.perturbing.perturb import (
    SUFFIXES,
    Perturbation,
    perturb_surface,
    write_perturbation,
)

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


def run(command: Perturb) -> int:
    """Run the command, and return the exit code."""
    output = command.output or Path(f"{safe_stem(command.file.stem)}_noise.ply")
    check: dict[str, Any] = {"overwrite": command.overwrite, "sources": [command.file]}
    check_output(output, SUFFIXES, "table or mesh", **check)
    check_output(command.figure, METADATA, "figure", **check)
    if command.figure is not None:
        check_rendering()
    perturbation = _perturb(command)
    write_perturbation(output, perturbation)
    if command.figure is not None:
        save_as(perturbation_figure(perturbation), command.figure)
    if not command.quiet:
        print_perturbation(perturbation, [output, *filter(None, [command.figure])])
    return 0


def _perturb(command: Perturb) -> Perturbation:
    """Read the mesh, and label its copies."""
    sampling = given_sampling(command.sampling, command.multifinger).fitted(command.model.fingers)
    surface = movable_surface(command.file, command.mesh)
    if not command.force:
        refuse_lengths(surface.mesh, command.model, sampling)
    text = f"labelling {command.noise.copies} copies of {command.file.name}"
    with progress_bars.progress(text, quiet=command.quiet):
        return perturb_surface(surface, command.model, noise=command.noise, sampling=sampling)


def print_perturbation(perturbation: Perturbation, paths: Sequence[Path]) -> None:
    """Print the noise, area fractions with and without it, and the errors to enter.

    Args:
        perturbation: Results of the copies.
        paths: The files that they were written to.
    """
    report = Report()
    mesh, model = perturbation.mesh, perturbation.labels.model
    words = [model_words(model), *error_texts(model, mesh.unit)]
    words += [] if model.fingers == 2 else [f"{model.fingers} fingers"]
    report.mesh(mesh, ", ".join(words))
    settings, unit = perturbation.settings, mesh.unit
    assert settings.noise is not None  # it is a number in results
    origin = "estimated from the surface's roughness" if perturbation.estimated else "as given"
    kind = (
        f"alike within {_length(settings.correlation, unit)}"
        if settings.correlation
        else "independent at every vertex"
    )
    report.line(
        f"noise of each of the {counted(settings.copies, 'copies')}: "
        f"{_length(settings.noise, unit)} along the normals ({origin}), {kind}"
    )
    areas = mesh.vertex_areas / mesh.vertex_areas.sum()
    own, copies = perturbation.labels.fractions(), perturbation.fractions
    report.labels(
        "label",
        ("scan", "noisy copies"),
        lambda label: [
            percent_text(own[label.name]),
            percent_text(float((areas * copies[label]).sum())),
        ],
    )
    for line in (*_measured(perturbation), *_advised(perturbation)):
        report.line(line)
    report.warnings(perturbation.labels.warnings)
    if mesh.report.warnings:
        report.paragraph(CHECK_HINT)
    report.written(*paths)


def _measured(perturbation: Perturbation) -> list[str]:
    """What noise does to normals, contacts and grasps."""
    advice, unit, level = perturbation.advice, perturbation.mesh.unit, perturbation.settings.level
    where = " across the line between them" if perturbation.labels.model.fingers == 2 else ""
    turn, shift = angle_text(advice.measured_turn), _length(perturbation.shift_across, unit)
    measured = (
        f"over {100.0 * level:g} % of the area and copies, normals turn by at most {turn} and "
        f"contacts shift by at most {shift}{where}"
    )
    if math.isnan(perturbation.confirmed_fraction):
        return [measured]
    right = (
        f"{percent_text(perturbation.confirmed_fraction)} of the area that is S in a copy has a "
        "grasp that is S on the scan as well; the rest is S because of the noise"
    )
    return [measured, right]


def _advised(perturbation: Perturbation) -> list[str]:
    """The errors to enter, and how they were checked."""
    advice, level = perturbation.advice, 100.0 * perturbation.settings.level
    if advice.stable_fraction < MIN_STABLE:
        return [NO_ADVICE.format(_remedy(perturbation))]
    location = _length(advice.location_error, perturbation.mesh.unit).replace(" ", "")
    words = f"--normal-error {math.degrees(advice.normal_error):.4g} --location-error {location}"
    stable, failing = map(percent_text, (advice.stable_fraction, advice.unconfirmed_fraction))
    own = perturbation.labels.model.normal_error
    contained = f" (they contain the {math.degrees(own):.4g}° given)" if own else ""
    checked = (
        f"with these errors{contained} {stable} of the area is S; {failing} of that is S in fewer "
        f"than {level:g} % of the copies"
    )
    lines = [f"[bold]enter: {words}[/]", checked]
    return lines if advice.passed else [*lines, NOT_PASSED.format(_remedy(perturbation))]


def _remedy(perturbation: Perturbation) -> str:
    """What makes the labels depend less on noise."""
    patch = perturbation.mesh.options.patch_radius
    if patch:
        radius = _length(patch, perturbation.mesh.unit)
        return f"average the normals over a patch larger than {radius} (--patch-radius)"
    return "average the normals over a patch of a few edge lengths (--patch-radius)"


def _length(length: float, unit: Unit | None) -> str:
    return small_length(length, unit, digits=3)
