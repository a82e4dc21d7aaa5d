"""The command `grasp3d check`: diagnoses meshes before they are labelled."""

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial

from rich.filesize import decimal
from rich.table import Table

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.checking import (
    CheckedMesh,
    check_file,
    json_of,
    lost_check,
    write_checks,
)
from grasp3d.batch.inputs import MeshFile, find_meshes
from grasp3d.batch.run import run as run_each
from grasp3d.batch.storage.files import local_path
from grasp3d.cli import progress_bars
from grasp3d.cli.commands import Check
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.report import FAILED, Report, duration_text, escaped, table_of
from grasp3d.mesh.diagnosis import MeshDiagnosis, SurfaceMeasures, Trust
from grasp3d.system.counts import counted

MAX_PAGES = 3
"""Largest number of meshes with a page each."""

_COLORS = {"yes": "green", "with care": "yellow", "no": "red"}
"""Colours of the values of `Trust`."""

_MIN_CHANGE = 1e-4
"""Relative change below which nothing is printed."""


def run(command: Check) -> int:
    """Run the command, and return the exit code."""
    files = find_meshes(command.inputs)
    sources = [local_path(file.source) for file in files]
    check_output(command.output, [".json"], "report", overwrite=command.overwrite, sources=sources)
    settings = BatchSettings(command.model, command.sampling, command.mesh)
    meshes = _checked(command, files, settings)
    if command.output is not None:
        write_checks(command.output, meshes, settings)
    if command.json:
        print(json_of(meshes, settings))  # noqa: T201
    elif not command.quiet:
        report, names = Report(), {str(local_path(item) or item) for item in command.inputs}
        if len(meshes) <= MAX_PAGES and all(file.source in names for file in files):
            for mesh in meshes:  # each was named, instead of folders or lists
                _print_page(report, mesh)
        else:
            _print_lines(report, meshes)
    accepted = {Trust.YES} if command.strict else {Trust.YES, Trust.CARE}
    return 0 if all(mesh.trust in accepted for mesh in meshes) else 1


def _checked(command: Check, files: list[MeshFile], settings: BatchSettings) -> list[CheckedMesh]:
    """Check one mesh in this process, several in child processes."""
    if len(files) == 1:
        return [check_file(files[0], settings, force=command.force)]
    check = partial(check_file, force=command.force)
    checks = run_each(
        check, files, settings, lost=lost_check, cluster=command.cluster, compiled=True
    )
    rows = progress_bars.counted_results(checks, "checking", len(files), quiet=command.quiet)
    return sorted(rows, key=lambda row: row.name)


def _print_page(report: Report, mesh: CheckedMesh) -> None:
    diagnosis = mesh.diagnosis
    if diagnosis is None:
        report.lines([mesh.refusal], FAILED)
        return
    file = f"{diagnosis.format.upper()}, {decimal(diagnosis.file_bytes or 0)}"
    report.paragraph(f"[bold]{escaped(diagnosis.mesh)}[/]: {file}")
    report.lines([_unit(diagnosis)], "unit:")
    extents = " x ".join(f"{extent:.4g}" for extent in diagnosis.extents)
    unit = " m" if diagnosis.unit else ""
    size = f"{diagnosis.size:.4g}{unit} (diameter of the bounding sphere)"
    report.line(f"extents {extents}{unit}; size {size}")
    report.table(_measures(diagnosis))
    for step in diagnosis.repairs:
        report.line(f"repaired: {step}")
    cost = diagnosis.cost
    report.paragraph(
        f"self-intersecting faces: {diagnosis.crossing_faces:,}; noise of normals: "
        f"{math.degrees(diagnosis.noise):.1f}°"
    )
    time = "a second" if cost.seconds < 1.0 else duration_text(cost.seconds)
    report.paragraph(
        f"labelling: {counted(diagnosis.label_vertices, 'vertices')}, "
        f"{'several times' if cost.more else 'about'} {time} and "
        f"{cost.memory:.1f} GB"
    )
    report.paragraph(f"labels can be trusted: {_colored(diagnosis.trust)}")
    for warning in diagnosis.warnings:
        report.lines([warning.message], _colored(warning.trust, "•"))


def _colored(trust: Trust, text: str | None = None) -> str:
    """A text in the colour of the trust; None: its own."""
    return f"[{_COLORS[trust]}]{trust if text is None else text}[/]"


def _unit(diagnosis: MeshDiagnosis) -> str:
    if diagnosis.file_unit is None:
        return f"not stated; {diagnosis.guess.reason}"
    if diagnosis.guess.unit in {None, diagnosis.file_unit}:
        return diagnosis.file_unit
    suggested = f"its size suggests {diagnosis.guess.unit}: {diagnosis.guess.reason}"
    return f"{diagnosis.file_unit} as stated; {suggested}"


def _measures(diagnosis: MeshDiagnosis) -> Table:
    """Return a table of the measures before and after repair."""
    before, after = both = diagnosis.before, diagnosis.after
    length, area, volume = (f", m{power}" if diagnosis.unit else "" for power in ("", *"²³"))
    volumes = ("open" if state.volume is None else f"{state.volume:.5g}" for state in both)
    rows = [
        ("vertices, faces", *(f"{state.vertices:,} {state.faces:,}" for state in both), ""),
        ("watertight", *map(_closed, both), ""),
        (f"area{area}", *(f"{state.area:.5g}" for state in both), _change(before.area, after.area)),
        (f"volume{volume}", *volumes, _change(before.volume, after.volume)),
        (f"centre of mass{length}", *(_center(state, diagnosis.size) for state in both), ""),
        ("bodies", "", str(diagnosis.bodies), ""),
    ]
    table = table_of(("", "in the file", "after repair", "change"), rows, folded=True)
    table.columns[-1].justify = "left"
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


def _change(before: float | None, after: float | None) -> str:
    if before is None or after is None or abs(after - before) <= _MIN_CHANGE * abs(after):
        return ""
    if before * after < 0.0:
        return "inverted"
    if not before:
        return "new"
    percent = 100.0 * (after / before - 1.0)
    return f"{percent:+.2g} %" if abs(percent) < 99.5 else f"{percent:+,.0f} %"


def _print_lines(report: Report, meshes: Sequence[CheckedMesh]) -> None:
    """Print a line for each mesh, then the errors and the warnings."""
    headings = ("faces", "size", "bodies", "closed", "repairs", "crossing", "noise")
    table = table_of(("mesh", "labels", *headings), map(_cells, meshes))
    table.columns[0].min_width, table.columns[1].justify = 12, "left"
    table.padding = (0, 1, 0, 0)
    report.table(table)
    report.paragraph(
        "labels: whether they can be trusted; size: with the stated unit, or with ? the unit that "
        "it suggests; closed: watertight, in the file > after repair; repairs: kinds of repair; "
        "crossing: self-intersecting faces; noise: of the normals"
    )
    for mesh in meshes:
        if mesh.diagnosis is None:
            report.lines([mesh.refusal], FAILED)
            continue
        for warning in mesh.diagnosis.warnings:
            mark = _colored(warning.trust, f"{warning.trust}:")
            report.lines([f"{mesh.name}: {warning.message}"], mark)
    trusts = Counter(mesh.diagnosis.trust for mesh in meshes if mesh.diagnosis is not None)
    counts = ", ".join(f"{trusts[trust]} {trust}" for trust in _COLORS)  # type: ignore[index]
    report.paragraph(
        f"{counted(len(meshes), 'meshes')}; labels can be trusted: {counts}; "
        f"{len(meshes) - trusts.total()} failed"
    )


def _cells(mesh: CheckedMesh) -> list[str]:
    diagnosis = mesh.diagnosis
    if diagnosis is None:
        return [escaped(mesh.name), "[red]failed[/]", *[""] * 7]
    before, after = ("yes" if one.closed else "no" for one in (diagnosis.before, diagnosis.after))
    unit = "m" if diagnosis.unit else f"{diagnosis.guess.unit or ''}?"
    return [
        escaped(mesh.name),
        _colored(diagnosis.trust),
        f"{diagnosis.after.faces:,}",
        f"{diagnosis.size:.3g} {unit}",
        str(diagnosis.bodies),
        before if before == after else f"{before} > {after}",
        str(len(diagnosis.repairs)),
        str(diagnosis.crossing_faces),
        f"{math.degrees(diagnosis.noise):.1f}°",
    ]
