"""Printed reports of labels on standard output, and progress bars on standard error."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from grasp3d.cli.load_report import print_load
from grasp3d.cli.uncertainty_report import uncertainty_lines
from grasp3d.grasps.verdict import verdict_of
from grasp3d.hand.scene import Scene
from grasp3d.settings import Sampling
from grasp3d.settings.lengths import Unit
from grasp3d.settings.model_text import MINIMUM, friction_text
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import COLORS, MEANING
from grasp3d.stability.label import Label as Code
from grasp3d.surface.area_statistics import vertex_weights
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.compiling import compilations
from grasp3d.system.counts import counted
from grasp3d.system.names import printable
from grasp3d.system.progress import Progress as ProgressFunction
from grasp3d.system.steps import begin_step

_REASONS = {
    Reason.NO_PARTNER: "no opposing contacts within the search cone give force closure",
    Reason.OPENING: "all opposing contacts are closer or farther than the limits allow",
    Reason.NOT_REACHED: "the gripper reaches none of their grasps",
    Reason.OFF_SURFACE: "in no face, so their label is U and their area 0",
}
"""Explanations of vertices without a grasp."""

CHECK_HINT = "`grasp3d check` reports the defects of a mesh and their remedies"

UNLIMITED = 1000
"""Characters in a line, more than any table has."""


def escaped(text: str) -> str:
    """Return a text for the console: one line, with markup characters escaped."""
    return escape(printable(text))


def print_table(console: Console, table: Table) -> None:
    """Print a table with all of its numbers, also where the console is too narrow for it."""
    unlimited = console.options.update(max_width=UNLIMITED)
    table.width = console.measure(table, options=unlimited).maximum
    console.print(table, crop=False)


@contextmanager
def progress(text: str, *, quiet: bool) -> Iterator[ProgressFunction]:
    """Show a progress bar; yields a function of the fraction of the work that is done."""
    with _bar(TextColumn("{task.percentage:>3.0f} %"), quiet=quiet) as bar:
        task = bar.add_task(escaped(text), total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)


def measure(compute: Callable[[ProgressFunction], None], text: str, *, quiet: bool) -> None:
    """Compute something with a progress bar, as a step that a time limit names."""
    begin_step(text)
    with progress(text, quiet=quiet) as report:
        compute(report)


@contextmanager
def counter(text: str, total: int, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """Show a progress bar that counts meshes; yields a function to call after each mesh."""
    with _bar(MofNCompleteColumn(), quiet=quiet) as bar:
        task = bar.add_task(text, total=total)
        yield lambda: bar.advance(task)


@contextmanager
def waiting(text: str, *, quiet: bool) -> Iterator[None]:
    """Show that something is being done, of which no fraction is known."""
    with _bar(quiet=quiet) as bar:
        bar.add_task(text, total=None)
        yield


class _Kernel(ProgressColumn):
    """The kernel that is being compiled."""

    def render(self, task: Task) -> Text:  # noqa: ARG002, the interface of Rich
        """The column's text."""
        kernel = compilations.current
        return Text(f"compiling {kernel}" if kernel else "", style="dim")


def _bar(*columns: ProgressColumn, quiet: bool) -> Progress:
    console = Console(stderr=True, quiet=quiet, soft_wrap=True, emoji=False)
    return Progress(
        TextColumn("{task.description}"), BarColumn(), *columns, TimeElapsedColumn(), _Kernel(),
        console=console, transient=True, disable=quiet or not console.is_terminal,
    )  # fmt: skip


def print_labels(labels: SurfaceLabels, output: Path) -> None:
    """Print the settings, area fractions, quantiles, repairs and warnings of a labelled surface.

    Args:
        labels: Labels of the surface.
        output: The file that they were written to.
    """
    console = Console(emoji=False)
    mesh = labels.mesh
    _print_settings(console, labels)
    table = Table("label", "", "area fraction", box=None, pad_edge=False)
    for name, fraction in labels.fractions().items():
        code = Code[name]
        color = "#{:02X}{:02X}{:02X}".format(*COLORS[code])
        table.add_row(f"[{color}]■[/] {name}", MEANING["label"][code], f"{100.0 * fraction:.1f} %")
    console.print(table)
    if labels.sampling is not None:
        console.print(f"[bold]{escaped(str(verdict_of(labels).text))}[/]", soft_wrap=True)
    console.print(
        "critical friction angle, 10/50/90 % of the area: "
        + ", ".join(angle_text(angle) for angle in labels.angle_quantiles([0.1, 0.5, 0.9]))
    )
    weights = vertex_weights(mesh, "area")
    for line in uncertainty_lines(labels, weights, of="area", unit=mesh.unit):
        console.print(escaped(line), soft_wrap=True)
    console.print(_epsilon_text(labels), soft_wrap=True)
    print_load(console, labels)
    counts = np.bincount(labels.reason, minlength=len(Reason))
    for reason, explanation in _REASONS.items():
        if counts[reason]:
            console.print(f"{counted(int(counts[reason]), 'vertices')}: {explanation}")
    for step in mesh.report.repairs:
        console.print(f"repaired: {escaped(str(step))}")
    for line in labels.warnings:
        console.print(f"[yellow]warning:[/] {escaped(line)}", soft_wrap=True)
    if mesh.report.warnings:
        console.print(CHECK_HINT)
    console.print(f"written: {escaped(str(output))}", soft_wrap=True)


def _print_settings(console: Console, labels: SurfaceLabels) -> None:
    """Print the mesh, the model, the gripper, and settings of the search that are not default."""
    mesh, model = labels.mesh, labels.model
    console.print(
        f"[bold]{escaped(mesh.report.source)}[/]: "
        f"{counted(len(mesh.vertices), 'vertices')}, "
        f"size {length_with_unit(mesh.size, mesh.unit)}; friction {friction_text(model)}, "
        f"sensor resolution {math.degrees(model.sensor_resolution):.4g}°"
        + ("" if model.fingers == 2 else f", {model.fingers} fingers"),
        soft_wrap=True,
    )
    if model.method == "extremes":
        console.print(
            f"labels from wrench hulls at {model.extreme_normals} extreme normals per contact, "
            f"{'circular cones' if model.edges is None else f'cones of {model.edges} edges'}"
        )
    if labels.sampling is not None and (differences := _differences(labels)):
        console.print("search settings: " + differences)
    if labels.scene is not None:
        console.print(_scene_text(labels.scene, mesh.size, mesh.unit), soft_wrap=True)
    if labels.search.evaluated and model.fingers > 2:
        console.print(f"{counted(labels.search.evaluated, 'candidate grasps')} evaluated")


def _epsilon_text(labels: SurfaceLabels) -> str:
    """Return the quantiles of epsilon and of its minimum over the tilts."""
    nominal, minimum = (
        ", ".join(f"{value:.3f}" for value in labels.epsilon_quantiles([0.1, 0.5, 0.9], of=of))
        for of in ("nominal", "minimum")
    )
    return f"epsilon, 10/50/90 % of the area: {nominal}; {MINIMUM[labels.model.tilts]}: {minimum}"


def _scene_text(scene: Scene, size: float, unit: Unit | None) -> str:
    """Return the gripper, the table, and the limit of approach directions."""
    hand, table, approach = scene.hand, scene.table, scene.approach
    text = f"gripper {escaped(hand.name)}, stroke {1000.0 * hand.max_opening:.4g} mm"
    if table is not None:
        up = ", ".join(f"{number + 0.0:.3g}" for number in table.normal)
        height = round(table.offset / size, 9) * size + 0.0  # without rounding errors
        text += f"; table at {length_with_unit(height, unit)}, up ({up})"
        if table.probability is not None:
            text += f", resting pose of probability {100.0 * table.probability:.0f} %"
    if approach.within < math.pi:
        text += f"; approach within {math.degrees(approach.within):.4g}°"
    return text


def _differences(labels: SurfaceLabels) -> str:
    """Return the settings of the search that differ from their defaults."""
    given = labels.sampling or Sampling()
    defaults = plain_values(type(given)())
    angles, lengths = ("search_angle", "tolerance"), given.length_names()

    def text(name: str, value: float) -> str:
        if name in angles:
            return f"{math.degrees(value):.4g}°"
        return length_with_unit(value, labels.mesh.unit) if name in lengths else f"{value}"

    return ", ".join(
        f"{name} {text(name, value)}"
        for name, value in plain_values(given).items()
        if value != defaults[name]
    )


def length_with_unit(length: float, unit: Unit | None) -> str:
    """Format a length in the mesh's unit."""
    return f"{length:.4g} {unit or '(unit not stated)'}"


def angle_text(angle: float) -> str:
    """Format an angle in degrees; an infinite angle means that there is no grasp."""
    return "none" if math.isinf(angle) else f"{math.degrees(angle):.1f}°"
