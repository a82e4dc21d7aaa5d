"""What is done for one mesh: a pure function of the file and the settings."""

import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from grasp3d.errors import GraspError
from grasp3d.settings import GraspModel, MeshOptions, Sampling

DECILES = (0.1, 0.5, 0.9)


@dataclass(frozen=True)
class BatchSettings:
    """What all meshes are labelled with, or checked for."""

    model: GraspModel = field(default_factory=GraspModel)
    sampling: Sampling = field(default_factory=Sampling)
    mesh: MeshOptions = field(default_factory=MeshOptions)


@dataclass(frozen=True)
class Job:
    """One mesh to label."""

    name: str
    """How the mesh is called in the summary: its path below the folder that was given."""
    source: Path
    output: Path
    """Folder for the results."""
    labeled: str
    """Labelled file to write, below `output`; the suffix chooses the format."""

    @property
    def target(self) -> Path:
        """Labelled file to write."""
        return self.output / self.labeled


@dataclass(frozen=True)
class Row:
    """One line of the summary; `error` is empty for a mesh that was labelled."""

    mesh: str
    source: str = ""
    """The file, as it was given."""
    error: str = ""
    labeled: str = ""
    """Name of the labelled file, below the output folder."""
    vertices: int | None = None
    faces: int | None = None
    size: float | None = None
    """Diameter of the ball around the surface, in the mesh's unit."""
    unit: str | None = None
    closed: bool | None = None
    stable: float | None = None
    """Share of the surface labelled S, by area."""
    ambiguous: float | None = None
    """Share labelled M."""
    no_grasp_found: float | None = None
    """Share labelled U."""
    critical_angle_p10: float | None = None
    """Quantiles of the critical friction angle over the surface [rad]; inf: no grasp found."""
    critical_angle_p50: float | None = None
    critical_angle_p90: float | None = None
    epsilon_p10: float | None = None
    """Quantiles of epsilon at the nominal normals over the surface; 0: no grasp found."""
    epsilon_p50: float | None = None
    epsilon_p90: float | None = None
    epsilon_min_p10: float | None = None
    """Quantiles of the smallest epsilon over all tilts."""
    epsilon_min_p50: float | None = None
    epsilon_min_p90: float | None = None
    torque_scale: float | None = None
    """Length that torques in epsilon are divided by, in the mesh's unit."""
    repairs: str = ""
    warnings: str = ""
    seconds: float = 0.0


def label_file(job: Job, settings: BatchSettings) -> Row:
    """Label one mesh file and write the labelled file.

    Args:
        job: The file and where its labels go.
        settings: Model, sampling and mesh options.

    Returns:
        The mesh's row of the summary; a mesh that cannot be labelled has its reason in `error`.
    """
    begun = time.perf_counter()
    try:
        row = _labeled(job, settings)
    except GraspError as error:
        row = Row(job.name, error=str(error))
    return replace(row, source=str(job.source), seconds=time.perf_counter() - begun)


def lost_row(job: Job, reason: str) -> Row:
    """Row of a mesh whose process did not come back with one.

    Args:
        job: The file.
        reason: What ended the process.
    """
    return Row(job.name, str(job.source), f"{job.source}: {reason}")


def _labeled(job: Job, settings: BatchSettings) -> Row:
    # Loaded here: whoever plans a batch or reads its rows needs no rays and no compiler.
    from grasp3d.diagnosis.lengths import length_doubts  # noqa: PLC0415
    from grasp3d.export import writer_for  # noqa: PLC0415
    from grasp3d.mesh import prepare_file  # noqa: PLC0415
    from grasp3d.surface import label_surface  # noqa: PLC0415

    mesh = prepare_file(job.source, settings.mesh, threads=1)
    labels = label_surface(mesh, settings.model, sampling=settings.sampling, threads=1)
    writer_for(job.target)(job.target, labels)
    fractions = labels.fractions()
    doubts = length_doubts(mesh.size, mesh.unit, settings.model, settings.sampling, settings.mesh)
    return Row(
        mesh=job.name,
        labeled=job.labeled,
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        size=mesh.size,
        unit=mesh.unit,
        closed=mesh.report.closed,
        stable=fractions["S"],
        ambiguous=fractions["M"],
        no_grasp_found=fractions["U"],
        **_deciles("critical_angle", labels.angle_quantiles(DECILES)),
        **_deciles("epsilon", labels.epsilon_quantiles(DECILES)),
        **_deciles("epsilon_min", labels.epsilon_quantiles(DECILES, of="minimum")),
        torque_scale=mesh.torque_scale,
        repairs="; ".join(map(str, mesh.report.repairs)),
        warnings="; ".join((*mesh.report.warnings, *doubts)),
    )


def _deciles(name: str, values: Iterable[float]) -> dict[str, Any]:
    """Name the quantiles of one quantity as the summary has them."""
    return {
        f"{name}_p{100.0 * level:.0f}": float(value)
        for level, value in zip(DECILES, values, strict=True)
    }
