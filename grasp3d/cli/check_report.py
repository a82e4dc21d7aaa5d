"""Printed report of `grasp3d check`."""

import math
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from grasp3d.batch.checking import CheckedMesh
from grasp3d.cli.report import escaped
from grasp3d.mesh.diagnosis import MeshDiagnosis, SurfaceMeasures, Trust
from grasp3d.system.counts import counted, noun

MAX_PAGES = 3
"""Largest number of meshes with a page each."""

_COLORS = {Trust.YES: "green", Trust.CARE: "yellow", Trust.NO: "red"}
_MIN_CHANGE = 1e-4
"""Relative change below which nothing is printed."""


def print_checks(meshes: Sequence[CheckedMesh], *, named: bool) -> None:
    """Print a page for each of a few named meshes, otherwise a line for each mesh.

    Args:
        meshes: Checked meshes.
        named: Whether the user named every mesh, instead of folders or lists.
    """
    console = Console()
    if named and len(meshes) <= MAX_PAGES:
        for mesh in meshes:
            _print_page(console, mesh)
        return
    _print_lines(console, meshes)


def _print_page(console: Console, mesh: CheckedMesh) -> None:
    found = mesh.diagnosis
    if found is None:
        console.print(f"[red]failed:[/] {escaped(mesh.refusal)}", soft_wrap=True)
        return
    console.print(f"[bold]{escaped(found.mesh)}[/]: {found.format.upper()}, {_bytes(found)}")
    console.print(f"unit: {escaped(_unit(found))}", soft_wrap=True)
    extents = " x ".join(f"{extent:.4g}" for extent in found.extents)
    unit = f" {found.unit}" if found.unit else ""
    console.print(
        f"extents {extents}{unit}; size {found.size:.4g}{unit} (diameter of the bounding sphere)",
        soft_wrap=True,
    )
    console.print(_measures(found))
    for step in found.repairs:
        console.print(f"repaired: {step}", soft_wrap=True)
    console.print(
        f"self-intersecting faces: {found.crossing_faces:,}; noise of normals: "
        f"{math.degrees(found.noise):.1f}°; manifold: {_manifold(found)}"
    )
    console.print(
        f"labelling: {counted(found.label_vertices, 'vertices')}, "
        f"{'several times' if found.cost.more else 'about'} {_seconds(found.cost.seconds)} and "
        f"{found.cost.memory:.1f} GB"
    )
    color = _COLORS[found.trust]
    console.print(f"labels can be trusted: [{color}]{found.trust}[/]")
    for warning in found.warnings:
        console.print(f"[{_COLORS[warning.trust]}]•[/] {escaped(warning.message)}", soft_wrap=True)


def _unit(found: MeshDiagnosis) -> str:
    if found.unit is None:
        return f"not stated; {found.guess.reason}"
    if found.guess.unit in {None, found.unit}:
        return found.unit
    return f"{found.unit} as stated; its size suggests {found.guess.unit}: {found.guess.reason}"


def _manifold(found: MeshDiagnosis) -> str:
    return "yes" if found.manifold == "NoError" else f"no ({found.manifold})"


def _measures(found: MeshDiagnosis) -> Table:
    """Return a table of the measures before and after repair."""
    table = Table("", box=None, pad_edge=False)
    for heading in ("in the file", "after repair"):
        table.add_column(heading, justify="right")
    table.add_column("change")
    before, after = found.before, found.after
    for name, cells in {
        "vertices, faces": [f"{m.vertices:,} {m.faces:,}" for m in (before, after)],
        "watertight": [_closed(m) for m in (before, after)],
    }.items():
        table.add_row(name, *cells, "")
    length, area, volume = (f", {found.unit}{power}" if found.unit else "" for power in ("", *"²³"))
    table.add_row(
        f"area{area}",
        f"{before.area:.5g}",
        f"{after.area:.5g}",
        _change(before.area, after.area),
    )
    table.add_row(
        f"volume{volume}",
        *(_volume(m) for m in (before, after)),
        _volume_change(before, after),
    )
    shift = found.center_shift if before.closed and after.closed else 0.0
    table.add_row(
        f"centre of mass{length}",
        *(_center(m, found.size) for m in (before, after)),
        f"{100.0 * shift:.2g} % of the size" if shift > _MIN_CHANGE else "",
    )
    cavities = f", cavities: {found.cavities}" if found.cavities else ""
    table.add_row("bodies", "", f"{found.bodies}{cavities}", "")
    return table


def _closed(measured: SurfaceMeasures) -> str:
    words = ["yes" if measured.closed else "no"]
    if not measured.closed and not measured.boundary_edges:
        words.append("inconsistent orientation")
    if measured.boundary_edges:
        words.append(f"{counted(measured.boundary_edges, 'edges')} with one face")
    if measured.crowded_edges:
        words.append(f"{measured.crowded_edges:,} with more than two")
    return ", ".join(words)


def _center(measured: SurfaceMeasures, size: float) -> str:
    """Format the centre of mass, to a thousandth of the object's size."""
    if not measured.closed:
        return "open"
    digits = max(0, 3 - math.floor(math.log10(size)))
    return " ".join(f"{round(x, digits) + 0.0:.{digits}f}" for x in measured.center_mass)


def _volume(measured: SurfaceMeasures) -> str:
    return "open" if measured.volume is None else f"{measured.volume:.5g}"


def _volume_change(before: SurfaceMeasures, after: SurfaceMeasures) -> str:
    if before.volume is None or after.volume is None:
        return ""
    return _change(before.volume, after.volume)


def _change(before: float, after: float) -> str:
    if abs(after - before) <= _MIN_CHANGE * abs(after):
        return ""
    if before * after < 0.0:
        return "inverted"
    if not before:
        return "new"
    percent = 100.0 * (after / before - 1.0)
    return f"{percent:+.2g} %" if abs(percent) < 99.5 else f"{percent:+,.0f} %"


def _bytes(found: MeshDiagnosis) -> str:
    size = float(found.file_bytes or 0)
    for unit in ("bytes", "kB", "MB"):
        if size < 1000.0:
            return f"{size:.3g} {noun(int(size), unit)}"
        size /= 1000.0
    return f"{size:.3g} GB"


def _seconds(seconds: float) -> str:
    if seconds < 1.0:
        return "a second"
    minutes = seconds / 60.0
    return f"{seconds:.0f} s" if minutes < 2.0 else f"{minutes:.0f} min"


def _print_lines(console: Console, meshes: Sequence[CheckedMesh]) -> None:
    """Print a line for each mesh, then the errors and the warnings."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("mesh", overflow="fold", min_width=12)
    table.add_column("labels", no_wrap=True)
    for heading in (
        "faces",
        "size",
        "bodies",
        "closed",
        "repairs",
        "crossing",
        "noise",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for mesh in meshes:
        table.add_row(*_cells(mesh))
    console.print(table)
    console.print(
        "labels: whether they can be trusted; size: with the stated unit, or with ? the unit that "
        "it suggests; closed: watertight, in the file > after repair; repairs: kinds of repair; "
        "crossing: self-intersecting faces; noise: of the normals"
    )
    for mesh in meshes:
        if mesh.diagnosis is None:
            console.print(f"[red]failed:[/] {escaped(mesh.refusal)}", soft_wrap=True)
            continue
        for warning in mesh.diagnosis.warnings:
            text = escaped(f"{mesh.name}: {warning.message}")
            console.print(f"[{_COLORS[warning.trust]}]{warning.trust}:[/] {text}", soft_wrap=True)
    trusts = [mesh.diagnosis.trust for mesh in meshes if mesh.diagnosis is not None]
    counts = [f"{trusts.count(trust)} {trust}" for trust in Trust]
    console.print(
        f"{counted(len(meshes), 'meshes')}; labels can be trusted: {', '.join(counts)}; "
        f"{len(meshes) - len(trusts)} failed"
    )


def _cells(mesh: CheckedMesh) -> list[str]:
    found = mesh.diagnosis
    if found is None:
        return [escaped(mesh.name), "[red]failed[/]", *[""] * 7]
    before, after = ("yes" if one.closed else "no" for one in (found.before, found.after))
    unit = found.unit or (f"{found.guess.unit}?" if found.guess.unit else "?")
    return [
        escaped(mesh.name),
        f"[{_COLORS[found.trust]}]{found.trust}[/]",
        f"{found.after.faces:,}",
        f"{found.size:.3g} {unit}",
        str(found.bodies),
        before if before == after else f"{before} > {after}",
        str(len(found.repairs)),
        str(found.crossing_faces),
        f"{math.degrees(found.noise):.1f}°",
    ]
