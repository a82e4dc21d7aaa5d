"""The command `grasp3d check`: diagnoses meshes before they are labelled."""

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.inputs import MeshFile, find_meshes, local_copy
from grasp3d.cli.commands import Check
from grasp3d.cli.report import FAILED, Report, escaped, exact_angle
from grasp3d.jobs.running import Done
from grasp3d.mesh.diagnosis import MeshDiagnosis, Trust, check_mesh
from grasp3d.settings.parsing import plain_values
from grasp3d.surface.fields import NONE
from grasp3d.system.documents import package_version
from grasp3d.system.files import atomic_write
from grasp3d.system.names import short_number
from grasp3d.system.places import local_path

Checked = Done[MeshFile, MeshDiagnosis]
"""Check of one mesh: its diagnosis, or the error with which it is refused."""

COLORS = {Trust.YES: "green", Trust.CARE: "yellow", Trust.NO: "red"}
"""Colours for the values of `Trust`."""

LEGEND = "labels: whether they can be trusted; extents in mm and volumes in m³ if the unit is known"

SCALES = {"m": 1e3, None: 1.0}
"""Factors from lengths to printed lengths; millimetres if the unit is known."""

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
"""Columns of the table of meshes; they describe the meshes after repair."""


def run(command: Check, report: Report) -> int:
    """Run the command, and return the exit code."""
    files = find_meshes(command.inputs)
    sources = [local_path(file.source) for file in files]
    command.check_output(command.output, [".json"], "report", inputs=sources)
    settings = BatchSettings(command.model, command.sampling, command.mesh)
    meshes = report.each_mesh(check_file, files, settings, text="checking", command=command)
    if command.output is not None:
        write_checks(command.output, meshes, settings)
    _print(report, meshes)
    accepted = {Trust.YES} if command.strict else {Trust.YES, Trust.CARE}
    return 0 if all(trust_of(mesh) in accepted for mesh in meshes) else 1


def _print(report: Report, meshes: Sequence[Checked]) -> None:
    """Print a line for each mesh, then errors, repairs and warnings."""
    report.table(("mesh", "labels", *COLUMNS), map(_cells, meshes), texts=(0, 1))
    report.line(LEGEND)
    for mesh in meshes:
        found, name = mesh.value, mesh.job.name
        if found is None:
            report.lines([str(mesh.error)], FAILED)
            continue
        if found.file_unit is None:
            report.lines([f"{name}: unit not stated; {found.guess.reason}"])
        report.lines((f"{name}: {repair}" for repair in found.repairs), "repaired:")
        for warning in found.warnings:
            mark = f"[{COLORS[warning.trust]}]{warning.trust}:[/]"
            report.lines([f"{name}: {warning.message}"], mark)
    trusts = Counter(mesh.value.trust for mesh in meshes if mesh.value is not None)
    counts = ", ".join(f"{trusts[trust]} {trust}" for trust in COLORS)
    failed = len(meshes) - trusts.total()
    report.line(f"labels can be trusted: {counts}; {failed} failed")


def _cells(mesh: Checked) -> list[str]:
    found, name = mesh.value, mesh.job.name
    if found is None:
        return [escaped(name), "[red]failed[/]", *[""] * len(COLUMNS)]
    trust = f"[{COLORS[found.trust]}]{found.trust}[/]"
    return [escaped(name), trust, *(text(found) for text in COLUMNS.values())]


def check_file(mesh: MeshFile, settings: BatchSettings, *, force: bool = False) -> MeshDiagnosis:
    """Diagnose one mesh file.

    Args:
        mesh: The file.
        settings: Settings of the labels for which the mesh is checked.
        force: Accept lengths that are implausible for an object of this size.

    Raises:
        GraspError: The mesh is refused.
    """
    own = settings.of_mesh(mesh.own)
    with local_copy(mesh.source) as path:
        return check_mesh(
            path, model=own.model, sampling=own.sampling, options=own.mesh, force=force
        )


def trust_of(checked: Checked) -> Trust:
    """Return whether labels of a mesh can be trusted; a refused mesh has no labels."""
    return Trust.NO if checked.value is None else checked.value.trust


def write_checks(path: Path, meshes: Sequence[Checked], settings: BatchSettings) -> None:
    """Write the checks of meshes as JSON; lengths in metres, angles in radians.

    Args:
        path: File to create or replace.
        meshes: The checks; each mesh is named by its path below the input folder.
        settings: Settings of the check.

    Raises:
        OutputError: The file cannot be written.
    """
    entries = []
    for one in meshes:
        found = {} if one.value is None else asdict(one.value)
        refusal = None if one.error is None else str(one.error)
        head = {
            "mesh": one.job.name, "source": one.job.source, "trust": str(trust_of(one)),
            "refusal": refusal,
        }  # fmt: skip
        entries.append(head | found | head)
    header = {"version": package_version(), **_finite(plain_values(settings))}
    text = json.dumps({"grasp3d": header, "meshes": entries}, indent=1, allow_nan=False)
    with atomic_write(path) as part:
        part.write_text(text + "\n", encoding="utf-8")


def _finite(value: Any) -> Any:
    """Replace infinite limits by None, which JSON can hold."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    return None if value == float("inf") else value
