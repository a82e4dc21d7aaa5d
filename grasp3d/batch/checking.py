"""Checks of input meshes: a diagnosis of each mesh, or the reason why it is refused."""

from dataclasses import dataclass

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.inputs import MeshFile
from grasp3d.diagnosis.mesh_diagnosis import MeshDiagnosis, Trust
from grasp3d.errors import GraspError
from grasp3d.storage import local_copy


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
    from grasp3d.diagnosis import diagnose

    try:
        with local_copy(mesh.source) as path:
            found = diagnose(path, settings.model, settings.sampling, settings.mesh, force=force)
    except GraspError as error:
        return CheckedMesh(mesh.name, mesh.source, refusal=str(error))
    return CheckedMesh(mesh.name, mesh.source, found)


def lost_check(mesh: MeshFile, reason: str) -> CheckedMesh:
    """The check of a mesh whose process failed.

    Args:
        mesh: The file.
        reason: What ended the process.
    """
    return CheckedMesh(mesh.name, mesh.source, refusal=f"{mesh.source}: {reason}")
