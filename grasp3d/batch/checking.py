"""Checking what a command line names: a diagnosis, or the reason of a refusal, for each mesh."""

from dataclasses import dataclass

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.inputs import MeshFile
from grasp3d.diagnosis.mesh_diagnosis import MeshDiagnosis, Trust
from grasp3d.errors import GraspError
from grasp3d.storage import local_copy


@dataclass(frozen=True)
class CheckedMesh:
    """What came of one mesh: a diagnosis, or why it is refused."""

    name: str
    source: str
    diagnosis: MeshDiagnosis | None = None
    refusal: str = ""

    @property
    def trust(self) -> Trust:
        """Whether labels can be trusted; of a mesh that is refused there are none."""
        return Trust.NO if self.diagnosis is None else self.diagnosis.trust


def check_file(mesh: MeshFile, settings: BatchSettings) -> CheckedMesh:
    """Diagnose one mesh file.

    Args:
        mesh: The file.
        settings: What it is checked for.
    """
    # Loaded here: whoever plans needs no rays and no compiler.
    from grasp3d.diagnosis import diagnose

    try:
        with local_copy(mesh.source) as path:
            found = diagnose(path, settings.model, settings.sampling, settings.mesh)
    except GraspError as error:
        return CheckedMesh(mesh.name, mesh.source, refusal=str(error))
    return CheckedMesh(mesh.name, mesh.source, found)


def lost_check(mesh: MeshFile, reason: str) -> CheckedMesh:
    """What came of a mesh whose process did not come back.

    Args:
        mesh: The file.
        reason: What ended the process.
    """
    return CheckedMesh(mesh.name, mesh.source, refusal=f"{mesh.source}: {reason}")
