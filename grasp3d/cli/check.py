"""The command `grasp3d check`: diagnoses meshes before they are labelled."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from rich.filesize import decimal

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.checking import CheckedMesh, check_file, lost_check, write_checks
from grasp3d.batch.inputs import find_meshes
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

_COLORS = {Trust.YES: "green", Trust.CARE: "yellow", Trust.NO: "red"}
"""Colours of the values of `Trust`."""

COLUMNS: dict[str, Callable[[MeshDiagnosis], str]] = {
    "faces": lambda one: f"{one.after.faces:,}",
    "size": lambda one: length_with_unit(one.size, one.unit).replace(
        "unit not stated", f"{one.guess.unit or 'unit'}?"
    ),
    "bodies": lambda one: str(one.bodies),
    "closed": lambda one: "yes" if one.after.closed else "no",
    "repairs": lambda one: str(len(one.repairs)),
    "crossing": lambda one: str(one.crossing_faces),
    "noise": lambda one: exact_angle(one.noise),
}
"""Columns of the table of several meshes."""

LEGEND = (
    "labels: whether they can be trusted; size: with ?, the unit that it suggests; closed: "
    "watertight after repair; repairs: kinds of repair; crossing: self-intersecting faces; "
    "noise: of the normals"
)


def run(command: Check) -> int:
    """Run the command, and return the exit code."""
    files = find_meshes(command.inputs)
    sources = [local_path(file.source) for file in files]
    check_output(command.output, [".json"], "report", overwrite=command.overwrite, inputs=sources)
    settings = BatchSettings(command.model, command.sampling, command.mesh)
    meshes = progress_bars.each_mesh(
        check_file, files, settings, lost=lost_check, text="checking", command=command
    )
    if command.output is not None:
        write_checks(command.output, meshes, settings)
    report, [first, *others] = Report(quiet=command.quiet), meshes
    if others or first.diagnosis is None:
        _print_lines(report, meshes)
    else:
        _print_page(report, first.diagnosis)
    accepted = {Trust.YES} if command.strict else {Trust.YES, Trust.CARE}
    return 0 if all(mesh.trust in accepted for mesh in meshes) else 1


def _print_page(report: Report, diagnosis: MeshDiagnosis) -> None:
    size = decimal(diagnosis.file_bytes or 0)
    report.heading(diagnosis.mesh, f"{diagnosis.format.upper()}, {size}")
    report.values(_facts(diagnosis))
    report.lines(map(str, diagnosis.repairs), "repaired:")
    report.line(f"labels can be trusted: {_colored(diagnosis.trust)}")
    for warning in diagnosis.warnings:
        report.lines([warning.message], _colored(warning.trust, "•"))


def _colored(trust: Trust, text: str | None = None) -> str:
    """A text in the colour of the trust; None: its own."""
    return f"[{_COLORS[trust]}]{trust if text is None else text}[/]"


def _facts(diagnosis: MeshDiagnosis) -> Iterator[tuple[str, str]]:
    """Names and values of what a mesh is after repair, and of what labelling it takes."""
    found, closed, cost = diagnosis.after, _closed(diagnosis.before), diagnosis.cost
    length, area, volume = (f" m{power}" if diagnosis.unit else "" for power in ("", "²", "³"))
    yield "unit", _unit(diagnosis)
    extents = (length_with_unit(one, "m" if diagnosis.unit else None) for one in diagnosis.extents)
    yield "extents", " x ".join(one.removesuffix(" (unit not stated)") for one in extents)
    yield "size", f"{length_with_unit(diagnosis.size, diagnosis.unit)}, of the ball around it"
    yield "bodies", str(diagnosis.bodies)
    yield "surface", f"{found.vertices:,} vertices, {found.faces:,} faces, {found.area:.5g}{area}"
    yield (
        "watertight",
        closed
        if found.closed == diagnosis.before.closed
        else (f"{closed}; after repair {_closed(found)}"),
    )
    if found.volume is not None:
        digits = max(0, 3 - math.floor(math.log10(diagnosis.size)))
        center = (f"{round(x, digits) + 0.0:.{digits}f}" for x in found.center_mass)
        yield "volume", f"{found.volume:.5g}{volume}"
        yield "centre of mass", f"{' '.join(center)}{length}"
    yield "self-intersecting faces", f"{diagnosis.crossing_faces:,}"
    yield "noise of normals", exact_angle(diagnosis.noise)
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
    if measured.closed:
        return "yes"
    words = ["no"] if measured.boundary_edges else ["no", "inconsistent orientation"]
    if measured.boundary_edges:
        words.append(f"{counted(measured.boundary_edges, 'edges')} with one face")
    if measured.crowded_edges:
        words.append(f"{measured.crowded_edges:,} with more than two")
    return ", ".join(words)


def _print_lines(report: Report, meshes: Sequence[CheckedMesh]) -> None:
    """Print a line for each mesh, then the errors and the warnings."""
    report.table(("mesh", "labels", *COLUMNS), map(_cells, meshes), texts=(0, 1))
    report.line(LEGEND)
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
    if mesh.diagnosis is None:
        return [escaped(mesh.name), "[red]failed[/]", *[""] * len(COLUMNS)]
    texts = (text(mesh.diagnosis) for text in COLUMNS.values())
    return [escaped(mesh.name), _colored(mesh.diagnosis.trust), *texts]
