"""The command `grasp3d check`: diagnoses meshes before they are labelled."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial

from rich.filesize import decimal

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
from grasp3d.cli.report import (
    FAILED,
    Report,
    duration_text,
    escaped,
    exact_angle,
    length_with_unit,
)
from grasp3d.mesh.diagnosis import MeshDiagnosis, SurfaceMeasures, Trust
from grasp3d.system.counts import counted

MAX_PAGES = 3
"""Largest number of meshes with a page each."""

_COLORS = {Trust.YES: "green", Trust.CARE: "yellow", Trust.NO: "red"}
"""Colours of the values of `Trust`."""


def run(command: Check) -> int:
    """Run the command, and return the exit code."""
    files = find_meshes(command.inputs)
    sources = [local_path(file.source) for file in files]
    check_output(command.output, [".json"], "report", overwrite=command.overwrite, inputs=sources)
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
    size = decimal(diagnosis.file_bytes or 0)
    report.heading(diagnosis.mesh, f"{diagnosis.format.upper()}, {size}")
    report.values(_facts(diagnosis))
    both = diagnosis.before, diagnosis.after
    length, area, volume = (f", m{power}" if diagnosis.unit else "" for power in ("", *"²³"))
    rows = {
        "vertices": [f"{one.vertices:,}" for one in both],
        "faces": [f"{one.faces:,}" for one in both],
        "watertight": map(_closed, both),
        f"area{area}": [f"{one.area:.5g}" for one in both],
        f"volume{volume}": ["open" if one.volume is None else f"{one.volume:.5g}" for one in both],
        f"centre of mass{length}": [_center(one, diagnosis.size) for one in both],
    }
    lines = ([name, *texts] for name, texts in rows.items())
    report.table(("", "in the file", "after repair"), lines)
    report.lines(map(str, diagnosis.repairs), "repaired:")
    report.line(f"labels can be trusted: {_colored(diagnosis.trust)}")
    for warning in diagnosis.warnings:
        report.lines([warning.message], _colored(warning.trust, "•"))


def _colored(trust: Trust, text: str | None = None) -> str:
    """A text in the colour of the trust; None: its own."""
    return f"[{_COLORS[trust]}]{trust if text is None else text}[/]"


def _facts(diagnosis: MeshDiagnosis) -> Iterator[tuple[str, str]]:
    """Names and values of what a mesh is, and of what labelling it takes."""
    yield "unit", _unit(diagnosis)
    extents = (length_with_unit(one, "m" if diagnosis.unit else None) for one in diagnosis.extents)
    yield "extents", " x ".join(one.removesuffix(" (unit not stated)") for one in extents)
    yield "size", f"{length_with_unit(diagnosis.size, diagnosis.unit)}, of the ball around it"
    yield "bodies", str(diagnosis.bodies)
    yield "self-intersecting faces", f"{diagnosis.crossing_faces:,}"
    yield "noise of normals", exact_angle(diagnosis.noise)
    cost = diagnosis.cost
    time = "a second" if cost.seconds < 1.0 else duration_text(cost.seconds)
    vertices = counted(diagnosis.label_vertices, "vertices")
    often = "several times" if cost.more else "about"
    yield "labelling", f"{vertices}, {often} {time} and {cost.memory:.1f} GB"


def _unit(diagnosis: MeshDiagnosis) -> str:
    if diagnosis.file_unit is None:
        return f"not stated; {diagnosis.guess.reason}"
    if diagnosis.guess.unit in {None, diagnosis.file_unit}:
        return diagnosis.file_unit
    suggested = f"its size suggests {diagnosis.guess.unit}: {diagnosis.guess.reason}"
    return f"{diagnosis.file_unit} as stated; {suggested}"


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


def _print_lines(report: Report, meshes: Sequence[CheckedMesh]) -> None:
    """Print a line for each mesh, then the errors and the warnings."""
    headings = ("faces", "size", "bodies", "closed", "repairs", "crossing", "noise")
    report.table(("mesh", "labels", *headings), map(_cells, meshes), texts=(0, 1))
    report.line(
        "labels: whether they can be trusted; size: with ?, the unit that it suggests; closed: "
        "watertight after repair; repairs: kinds of repair; crossing: self-intersecting faces; "
        "noise: of the normals"
    )
    for mesh in meshes:
        if mesh.diagnosis is None:
            report.lines([mesh.refusal], FAILED)
            continue
        for warning in mesh.diagnosis.warnings:
            mark = _colored(warning.trust, f"{warning.trust}:")
            report.lines([f"{mesh.name}: {warning.message}"], mark)
    trusts = Counter(mesh.diagnosis.trust for mesh in meshes if mesh.diagnosis is not None)
    counts = ", ".join(f"{trusts[trust]} {trust}" for trust in _COLORS)
    report.line(
        f"{counted(len(meshes), 'meshes')}; labels can be trusted: {counts}; "
        f"{len(meshes) - trusts.total()} failed"
    )


def _cells(mesh: CheckedMesh) -> list[str]:
    diagnosis = mesh.diagnosis
    if diagnosis is None:
        return [escaped(mesh.name), "[red]failed[/]", *[""] * 7]
    size = length_with_unit(diagnosis.size, diagnosis.unit)
    return [
        escaped(mesh.name),
        _colored(diagnosis.trust),
        f"{diagnosis.after.faces:,}",
        size.replace("unit not stated", f"{diagnosis.guess.unit or 'unit'}?"),
        str(diagnosis.bodies),
        "yes" if diagnosis.after.closed else "no",
        str(len(diagnosis.repairs)),
        str(diagnosis.crossing_faces),
        exact_angle(diagnosis.noise),
    ]
