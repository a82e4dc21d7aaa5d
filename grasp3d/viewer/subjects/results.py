"""The results of a batch: labelled meshes, read from its files."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from grasp3d.batch.folders import MARKER
from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.store import read_summary
from grasp3d.errors import GraspError, MeshError
from grasp3d.export.read_labels import settings_of_file
from grasp3d.export.read_settings import FileSettings
from grasp3d.settings.lengths import Unit
from grasp3d.system.names import printable
from grasp3d.viewer.subjects.subject import Subject, read_subject


def labelled_rows(folder: Path) -> tuple[list[Row], int]:
    """Rows of the meshes that a batch has labelled, and the number of other meshes.

    Args:
        folder: Folder of the results.

    Raises:
        GraspError: It contains no results, they are damaged, or no mesh was labelled.
    """
    where = printable(str(folder))
    if not (folder / MARKER).is_file():
        raise MeshError(
            f"{where}: is a folder, but was not written by grasp3d batch; label its meshes with "
            "grasp3d batch, or give the path of one mesh"
        )
    rows = read_summary(folder)
    found = [row for row in rows if row.outcome is Outcome.LABELLED and row.labels]
    if not found:
        raise MeshError(
            f"{where}: none of its {len(rows)} meshes was labelled; see report/index.html"
        )
    return found, len(rows) - len(found)


def settings_of_results(
    folder: Path, rows: Sequence[Row], max_memory: float
) -> FileSettings | None:
    """Settings of the first mesh whose file can be read; None: no file can be read."""
    for row in rows:
        try:
            return settings_of_file(folder / row.labels, max_memory)
        except GraspError:
            continue  # the error is reported when that mesh is opened
    return None


def read_result(folder: Path, row: Row, max_memory: float, *, unit: Unit | None = None) -> Subject:
    """Read one mesh of a batch.

    If the table of its vertices cannot be read, the mesh is returned without partners.

    Args:
        folder: Folder of the results.
        row: Row of the mesh.
        max_memory: Memory limit for reading [GB].
        unit: Unit of a file that states none.

    Raises:
        MeshError: Its labelled PLY is missing or damaged.
    """
    read = partial(read_subject, max_memory=max_memory, unit=unit, name=row.mesh)
    path, notes = folder / row.fields, [text for text in row.warnings.split("; ") if text]
    try:
        subject, missing = read(path), []
        if row.size not in {None, subject.mesh.size}:
            raise MeshError(f"{printable(str(path))}: is of another mesh")
    except GraspError as error:
        subject = read(folder / row.labels)
        missing = [f"{error}: grasps are searched again when you click"]
    return replace(subject, notes=tuple(dict.fromkeys((*notes, *subject.notes, *missing))))
