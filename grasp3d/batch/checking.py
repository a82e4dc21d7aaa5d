"""Checks of input meshes: a diagnosis of each, or why it is refused; written as JSON."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.storage.files import local_copy
from grasp3d.errors import GraspError
from grasp3d.mesh.diagnosis import MeshDiagnosis, Trust
from grasp3d.settings.parsing import plain_values
from grasp3d.system.files import atomic_write
from grasp3d.system.versions import package_version


@dataclass(frozen=True)
class CheckedMesh:
    """The check of one mesh: a diagnosis, or why the mesh is refused."""

    name: str
    source: str
    diagnosis: MeshDiagnosis | None = None
    refusal: str = ""

    @property
    def trust(self) -> Trust:
        """Whether labels can be trusted; a refused mesh has no labels."""
        return Trust.NO if self.diagnosis is None else self.diagnosis.trust


def check_file(mesh: MeshFile, settings: BatchSettings, *, force: bool = False) -> CheckedMesh:
    """Diagnose one mesh file.

    Args:
        mesh: The file.
        settings: Settings of the labels that the mesh is checked for.
        force: Accept lengths that cannot be meant for an object of this size.
    """
    # Imported here: the process that plans needs neither ray tracing nor the compiler.
    from grasp3d.mesh.diagnosis import check_mesh

    try:
        with local_copy(mesh.source) as path:
            report = check_mesh(
                path,
                model=settings.model,
                sampling=settings.sampling,
                options=settings.mesh,
                force=force,
            )
    except GraspError as error:
        return CheckedMesh(mesh.name, mesh.source, refusal=str(error))
    return CheckedMesh(mesh.name, mesh.source, report)


def lost_check(mesh: MeshFile, reason: str) -> CheckedMesh:
    """The check of a mesh whose process failed.

    Args:
        mesh: The file.
        reason: What ended the process.
    """
    return CheckedMesh(mesh.name, mesh.source, refusal=f"{mesh.source}: {reason}")


def write_checks(path: Path, meshes: Sequence[CheckedMesh], settings: BatchSettings) -> None:
    """Write the checks of meshes as JSON; lengths in metres, angles in radians.

    Args:
        path: File to make or replace.
        meshes: From `check_file`.
        settings: Settings of the check.

    Raises:
        OutputError: The file cannot be written.
    """
    with atomic_write(path) as part:
        part.write_text(json_of(meshes, settings) + "\n", encoding="utf-8")


def json_of(meshes: Sequence[CheckedMesh], settings: BatchSettings) -> str:
    """The checks of meshes as JSON text."""
    entries = [
        _head(mesh) | ({} if mesh.diagnosis is None else asdict(mesh.diagnosis)) | _head(mesh)
        for mesh in meshes
    ]
    header = {"version": package_version(), **_finite(plain_values(settings))}
    return json.dumps({"grasp3d": header, "meshes": entries}, indent=1, allow_nan=False)


def _head(mesh: CheckedMesh) -> dict[str, str | None]:
    """Values that every mesh has; the mesh is named by its path below the input folder."""
    return {
        "mesh": mesh.name,
        "source": mesh.source,
        "trust": str(mesh.trust),
        "refusal": mesh.refusal or None,
    }


def _finite(value: Any) -> Any:
    """Replace infinite limits by none, which JSON can hold."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    return None if value == float("inf") else value
