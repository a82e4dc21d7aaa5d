"""Printed reports of labels on standard output, and progress bars on standard error."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from grasp3d._kernels.compiling import compiled_before
from grasp3d.diagnosis.length_warnings import length_warnings
from grasp3d.settings import Sampling, Tilts
from grasp3d.stability.label import COLORS, MEANING
from grasp3d.stability.label import Label as Code
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.names import printable
from grasp3d.system.progress import Progress as ProgressFunction

_REASONS = {
    Reason.NO_PARTNER: "no opposing contacts within the search cone give force closure",
    Reason.OPENING: "all opposing contacts are outside the limits of distances",
    Reason.OFF_SURFACE: "they belong to no face; their label is U, and their area is 0",
}
"""Explanations of vertices without a grasp."""

CHECK_HINT = "`grasp3d check` reports the defects of a mesh and their remedies"
_MINIMUM: dict[Tilts, str] = {
    "exact": "smallest over all tilts",
    "effective_friction": "at the effective friction",
    "sampled_tilts": "smallest over sampled tilts",
}


def escaped(text: str) -> str:
    """Return a text for the console: one line, with markup characters escaped."""
    return escape(printable(text))


def print_compiling_note() -> None:
    """Print a note if the kernels must be compiled, which makes the first run slow."""
    if not compiled_before():
        line = "compiling for the first run; this takes a minute or two"
        Console(stderr=True, soft_wrap=True).print(line)


@contextmanager
def progress(text: str, *, quiet: bool) -> Iterator[ProgressFunction]:
    """Show a progress bar; yields a function of the fraction of the work that is done."""
    with _bar(TextColumn("{task.percentage:>3.0f} %"), quiet=quiet) as bar:
        task = bar.add_task(escaped(text), total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)


@contextmanager
def counter(text: str, total: int, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """Show a progress bar that counts meshes; yields a function to call after each mesh."""
    with _bar(MofNCompleteColumn(), quiet=quiet) as bar:
        task = bar.add_task(text, total=total)
        yield lambda: bar.advance(task)


def _bar(column: TextColumn | MofNCompleteColumn, *, quiet: bool) -> Progress:
    console = Console(stderr=True, quiet=quiet, soft_wrap=True, emoji=False)
    return Progress(
        TextColumn("{task.description}"), BarColumn(), column, TimeElapsedColumn(),
        console=console, transient=True, disable=quiet or not console.is_terminal,
    )  # fmt: skip


def print_labels(labels: SurfaceLabels, output: Path) -> None:
    """Print the settings, area fractions, quantiles, repairs and warnings of a labelled surface.

    Args:
        labels: Labels of the surface.
        output: The file that they were written to.
    """
    console = Console(emoji=False)
    mesh, model = labels.mesh, labels.model
    console.print(
        f"[bold]{escaped(mesh.report.source)}[/]: {len(mesh.vertices)} vertices, "
        f"size {mesh.size:.4g} {mesh.unit or '(unit not stated)'}; friction {model.friction:g}, "
        f"sensor resolution {math.degrees(model.sensor_resolution):.4g}°"
        + ("" if model.fingers == 2 else f", {model.fingers} fingers")
    )
    if model.method == "extremes":
        console.print(
            f"labels by enumeration: {model.extreme_normals} extreme normals per contact, cones "
            f"{'circular' if model.edges is None else f'with {model.edges} edges'}"
        )
    if labels.sampling is not None and (differences := _differences(labels.sampling)):
        console.print("search settings: " + differences)
    if labels.search.evaluated:
        console.print(f"{labels.search.evaluated:,} candidate grasps evaluated")
    table = Table("label", "", "area fraction", box=None, pad_edge=False)
    for name, fraction in labels.fractions().items():
        code = Code[name]
        color = "#{:02X}{:02X}{:02X}".format(*COLORS[code])
        table.add_row(f"[{color}]■[/] {name}", MEANING["label"][code], f"{100.0 * fraction:.1f} %")
    console.print(table)
    console.print(
        "critical friction angle, 10/50/90 % of the area: "
        + ", ".join(angle_text(angle) for angle in labels.angle_quantiles([0.1, 0.5, 0.9]))
    )
    console.print(_epsilon_text(labels))
    counts = np.bincount(labels.reason, minlength=len(Reason))
    for reason, explanation in _REASONS.items():
        if counts[reason]:
            console.print(f"{counts[reason]} vertices: {explanation}")
    for step in mesh.report.repairs:
        console.print(f"repaired: {escaped(str(step))}")
    sampling = labels.sampling or Sampling()
    warnings = length_warnings(mesh.size, mesh.unit, model, sampling, mesh.options)
    for line in (*mesh.report.warnings, *warnings):
        console.print(f"[yellow]warning:[/] {escaped(line)}")
    if mesh.report.warnings:
        console.print(CHECK_HINT)
    console.print(f"written: {escaped(str(output))}", soft_wrap=True)


def _epsilon_text(labels: SurfaceLabels) -> str:
    """Return the quantiles of epsilon and of its minimum over the tilts."""
    nominal, minimum = (
        ", ".join(f"{value:.3f}" for value in labels.epsilon_quantiles([0.1, 0.5, 0.9], of=of))
        for of in ("nominal", "minimum")
    )
    return f"epsilon, 10/50/90 % of the area: {nominal}; {_MINIMUM[labels.model.tilts]}: {minimum}"


def _differences(sampling: Sampling) -> str:
    """Return the settings of the search that differ from their defaults."""
    defaults, angles = asdict(Sampling()), ("search_angle", "tolerance")
    return ", ".join(
        f"{name} {math.degrees(value):.4g}°" if name in angles else f"{name} {value}"
        for name, value in asdict(sampling).items()
        if value != defaults[name]
    )


def angle_text(angle: float) -> str:
    """Format an angle in degrees; an infinite angle means that there is no grasp."""
    return "none" if math.isinf(angle) else f"{math.degrees(angle):.1f}°"
