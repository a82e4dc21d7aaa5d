"""What the commands show: progress on standard error, tables on standard output."""

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
from grasp3d.surface.labels import Reason, SurfaceLabels
from grasp3d.system.names import printable
from grasp3d.system.progress import Progress as Told

_WHY = {
    Reason.NO_PARTNER: "no place for the other fingers closes a grasp within the search cone",
    Reason.OPENING: "every place for the other fingers is outside the limits of distances",
    Reason.OFF_SURFACE: "they belong to no face, their label is U and counts nowhere",
}
MORE = "what is wrong with a mesh, and what helps, is told by `grasp3d check`"
_OVER: dict[Tilts, str] = {
    "exact": "smallest over all tilts",
    "effective_friction": "at the effective friction",
    "sampled_tilts": "smallest over sampled tilts",
}


def as_printed(text: str) -> str:
    """Make a name, or what holds one, be printed as it is and on one line."""
    return escape(printable(text))


def report_compiling() -> None:
    """Say why the first run takes so long."""
    if not compiled_before():
        line = "compiling, which the first run has to do; it takes a minute or two"
        Console(stderr=True, soft_wrap=True).print(line)


@contextmanager
def progress(text: str, *, quiet: bool) -> Iterator[Told]:
    """Show a bar for one piece of work; gives a function that takes the share done."""
    with _bar(TextColumn("{task.percentage:>3.0f} %"), quiet=quiet) as bar:
        task = bar.add_task(as_printed(text), total=1.0)
        yield lambda share: bar.update(task, completed=share)


@contextmanager
def counter(text: str, total: int, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """Show a bar that counts meshes; gives a function to call after each."""
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
    """Print how much of a surface is S, M and U, and what the labels rest on."""
    console = Console(emoji=False)
    mesh, model = labels.mesh, labels.model
    console.print(
        f"[bold]{as_printed(mesh.report.source)}[/]: {len(mesh.vertices)} vertices, "
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
        console.print("searched with " + differences)
    if labels.search.settled:
        console.print(f"{labels.search.settled:,} candidate grasps settled")
    table = Table("label", "", "share of area", box=None, pad_edge=False)
    for name, share in labels.fractions().items():
        code = Code[name]
        color = "#{:02X}{:02X}{:02X}".format(*COLORS[code])
        table.add_row(f"[{color}]■[/] {name}", MEANING["label"][code], f"{100.0 * share:.1f} %")
    console.print(table)
    console.print(
        "critical friction angle, 10/50/90 % of the area: "
        + ", ".join(angle_text(angle) for angle in labels.angle_quantiles([0.1, 0.5, 0.9]))
    )
    console.print(_told_epsilon(labels))
    counts = np.bincount(labels.reason, minlength=len(Reason))
    for reason, why in _WHY.items():
        if counts[reason]:
            console.print(f"{counts[reason]} vertices: {why}")
    for step in mesh.report.repairs:
        console.print(f"repaired: {as_printed(str(step))}")
    sampling = labels.sampling or Sampling()
    warnings = length_warnings(mesh.size, mesh.unit, model, sampling, mesh.options)
    for line in (*mesh.report.warnings, *warnings):
        console.print(f"[yellow]warning:[/] {as_printed(line)}")
    if mesh.report.warnings:
        console.print(MORE)
    console.print(f"written: {as_printed(str(output))}", soft_wrap=True)


def _told_epsilon(labels: SurfaceLabels) -> str:
    """Say what epsilon is on the surface, and over which tilts its minimum is taken."""
    nominal, least = (
        ", ".join(f"{value:.3f}" for value in labels.epsilon_quantiles([0.1, 0.5, 0.9], of=of))
        for of in ("nominal", "minimum")
    )
    return f"epsilon, 10/50/90 % of the area: {nominal}; {_OVER[labels.model.tilts]}: {least}"


def _differences(sampling: Sampling) -> str:
    """Name the settings of the search that are not the usual ones."""
    usual, angles = asdict(Sampling()), ("search_angle", "tolerance")
    return ", ".join(
        f"{name} {math.degrees(value):.4g}°" if name in angles else f"{name} {value}"
        for name, value in asdict(sampling).items()
        if value != usual[name]
    )


def angle_text(angle: float) -> str:
    """Write an angle in degrees; an infinite one, of no grasp, in words."""
    return "none" if math.isinf(angle) else f"{math.degrees(angle):.1f}°"
