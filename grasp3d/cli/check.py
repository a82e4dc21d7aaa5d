"""The command `grasp3d check`: diagnoses meshes before they are labelled."""

from collections import Counter
from collections.abc import Callable, Sequence

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.checking import CheckedMesh, check_file, lost_check, write_checks
from grasp3d.batch.inputs import find_meshes
from grasp3d.batch.storage.files import local_path
from grasp3d.cli.commands import Check
from grasp3d.cli.report import FAILED, Report, escaped, exact_angle
from grasp3d.mesh.diagnosis import MeshDiagnosis, Trust
from grasp3d.surface.fields import NONE
from grasp3d.system.counts import short_number

COLORS = {Trust.YES: "green", Trust.CARE: "yellow", Trust.NO: "red"}
"""Colours of the values of `Trust`."""

LEGEND = "labels: whether they can be trusted; of a known unit extents are in mm, volumes in m³"

SCALES = {"m": 1e3, None: 1.0}
"""Factors from lengths to those that are printed: of a known unit in millimetres."""

COLUMNS: dict[str, Callable[[MeshDiagnosis], str]] = {
    "unit": lambda one: one.file_unit or NONE,
    "extents": lambda one: " x ".join(short_number(x * SCALES[one.unit]) for x in one.extents),
    "faces": lambda one: f"{one.after.faces:,}",
    "bodies": lambda one: str(one.bodies),
    "closed": lambda one: "yes" if one.after.closed else "no",
    "volume": lambda one: NONE if one.after.volume is None else f"{one.after.volume:.4g}",
    "crossing\nfaces": lambda one: f"{one.crossing_faces:,}",
    "noise of\nnormals": lambda one: exact_angle(one.noise),
    "vertices\nto label": lambda one: f"{one.label_vertices:,}",
    "time,\ns": lambda one: f"{max(1.0, one.cost.seconds):.0f}{'+' * one.cost.more}",
    "memory,\nGB": lambda one: f"{one.cost.memory:.1f}",
}
"""Columns of the table of meshes, as they are after repair."""


def run(command: Check, report: Report) -> int:
    """Run the command, and return the exit code."""
    files = find_meshes(command.inputs)
    sources = [local_path(file.source) for file in files]
    command.check_output(command.output, [".json"], "report", inputs=sources)
    settings = BatchSettings(command.model, command.sampling, command.mesh)
    meshes = report.each_mesh(
        check_file, files, settings, lost=lost_check, text="checking", command=command
    )
    if command.output is not None:
        write_checks(command.output, meshes, settings)
    _print(report, meshes)
    accepted = {Trust.YES} if command.strict else {Trust.YES, Trust.CARE}
    return 0 if all(mesh.trust in accepted for mesh in meshes) else 1


def _print(report: Report, meshes: Sequence[CheckedMesh]) -> None:
    """Print a line for each mesh, then the errors, repairs and warnings."""
    report.table(("mesh", "labels", *COLUMNS), map(_cells, meshes), texts=(0, 1))
    report.line(LEGEND)
    for mesh in meshes:
        found = mesh.diagnosis
        if found is None:
            report.lines([mesh.refusal], FAILED)
            continue
        if found.file_unit is None:
            report.lines([f"{mesh.name}: unit not stated; {found.guess.reason}"])
        report.lines((f"{mesh.name}: {repair}" for repair in found.repairs), "repaired:")
        for warning in found.warnings:
            mark = f"[{COLORS[warning.trust]}]{warning.trust}:[/]"
            report.lines([f"{mesh.name}: {warning.message}"], mark)
    trusts = Counter(mesh.diagnosis.trust for mesh in meshes if mesh.diagnosis is not None)
    counts = ", ".join(f"{trusts[trust]} {trust}" for trust in COLORS)
    failed = len(meshes) - trusts.total()
    report.line(f"labels can be trusted: {counts}; {failed} failed")


def _cells(mesh: CheckedMesh) -> list[str]:
    found = mesh.diagnosis
    if found is None:
        return [escaped(mesh.name), "[red]failed[/]", *[""] * len(COLUMNS)]
    trust = f"[{COLORS[found.trust]}]{found.trust}[/]"
    return [escaped(mesh.name), trust, *(text(found) for text in COLUMNS.values())]
