"""Rows of the summary: the results of one mesh each, and their list."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from grasp3d.batch.identity import METHOD
from grasp3d.system.names import as_unicode
from grasp3d.system.tables import data_frame, table_of_records
from grasp3d.system.versions import package_version


class Outcome(StrEnum):
    """Whether a mesh was labelled."""

    LABELLED = "labelled"
    REFUSED = "refused"
    """The mesh cannot be labelled, and is tried again only when it or the settings change."""
    LOST = "lost"
    """Its process died, or exceeded the time or memory limit; the next run tries it again."""


@dataclass(frozen=True)
class BestGrasp:
    """One of the best distinct grasps of a mesh."""

    critical_angle: float
    """Critical friction angle over the worst normals [rad]."""
    max_resolution: float
    """Coarsest sensor resolution below which the grasp is S at the model's friction [rad]; 0:
    none."""
    epsilon: float
    """At the nominal normals."""
    opening: float
    """Largest distance between two contacts [m]."""
    points: tuple[tuple[float, float, float], ...]
    """Contact points, in the mesh's frame."""
    normals: tuple[tuple[float, float, float], ...]
    """Outward unit normals at the contact points."""
    label: str = ""
    """S, M or U, of everything that is stated."""
    score: float = 0.0
    """The one number by which grasps are sorted, from 0 to 1."""
    pose: tuple[float, ...] = ()
    """With a gripper: the rows of the 4 x 4 matrix from its frame to the mesh's, 16 numbers."""
    approach_margin: float | None = None
    """How far the approach may turn about the closing axis [rad]; none: no gripper."""
    grip_force: float | None = None
    """Force of each finger that holds it at the worst normals [N]; none: no load, or none does."""
    payload: float | None = None
    """Mass that it holds at the worst normals [kg]; none: no load, or no force at hand."""


@dataclass(frozen=True)
class Row:
    """One row of the summary; values that are unknown, as for unlabelled meshes, are none."""

    mesh: str
    """Name of the mesh: its path below the input folder."""
    source: str = ""
    """Path or address of the file, as given."""
    outcome: Outcome = Outcome.LABELLED
    error: str = ""
    """Why the mesh was not labelled."""
    bytes: int | None = None
    """Size of the file."""
    stamp: str = ""
    """State of the file according to the file system: the same stamp means the same content."""
    content: str = ""
    """SHA-256 of the file, and of the files that it refers to."""
    key: str = ""
    """SHA-256 of the content, the settings and the version of the method."""
    friction_min: float | None = None
    """Coulomb coefficient of the labels, the smallest where it is an interval."""
    friction_max: float | None = None
    """The same, the largest."""
    sensor_resolution: float | None = None
    """Resolution alpha of the labels [rad]."""
    location_error: float | None = None
    """Largest distance between true and perceived contact points [m]."""
    fingers: int | None = None
    gripper: str | None = None
    """Name of the gripper that must reach the grasps."""
    verdict: str | None = None
    """surely, perhaps or not; see `grasps.Verdict`."""
    verdict_text: str | None = None
    """The verdict in one to three sentences."""
    causes: str | None = None
    """Why parts of the surface are U, with their area fractions."""
    stable_grasps: int | None = None
    """Distinct S grasps that are reached."""
    spare_resolution: float | None = None
    """Of the best grasp: alpha* - alpha [rad]; negative: a finer sensor is needed."""
    task: str | None = None
    """What the grasps must resist, as text; none: there is no load."""
    mass: float | None = None
    """Mass of the object [kg]; none: not given."""
    grip_force_at_hand: float | None = None
    """Force at hand of each finger [N]; none: not given."""
    holds: bool | None = None
    """Whether some grasp holds the load, at the worst normals, with the force at hand."""
    held: float | None = None
    """Area fraction of the grasps that hold the load, at the worst normals, with that force."""
    grip_force_needed: float | None = None
    """Smallest force of each finger that holds it at the worst normals [N], 1 kg without a mass;
    inf: none does."""
    payload_best: float | None = None
    """Largest mass that a grasp holds, at the worst normals, with the force at hand [kg]."""
    payload_p10: float | None = None
    """Quantiles of the payload over the surface [kg]; 0: no grasp found."""
    payload_p50: float | None = None
    payload_p90: float | None = None
    labels: str = ""
    """Path of the labelled PLY below the output folder."""
    fields: str = ""
    """Path of the table of vertices below the output folder."""
    thumbnail: str = ""
    """Path of the thumbnail below the output folder."""
    vertices: int | None = None
    faces: int | None = None
    size: float | None = None
    """Diameter of the surface's bounding sphere [m]."""
    unit: str | None = None
    closed: bool | None = None
    area: float | None = None
    volume: float | None = None
    """Enclosed volume; none where the surface is open."""
    center_mass: tuple[float, float, float] | None = None
    torque_scale: float | None = None
    """Length by which torques are divided in epsilon [m]."""
    stable: float | None = None
    """Area fraction of S."""
    ambiguous: float | None = None
    """Area fraction of M."""
    no_grasp_found: float | None = None
    """Area fraction of U."""
    critical_angle_p10: float | None = None
    """Quantiles of the critical friction angle over the surface [rad]; inf: no grasp found."""
    critical_angle_p25: float | None = None
    critical_angle_p50: float | None = None
    critical_angle_p75: float | None = None
    critical_angle_p90: float | None = None
    margin_p10: float | None = None
    """Quantiles of the margin over the surface [rad]: by how much the friction angle exceeds what
    the critical angle and all uncertainties need; -inf: no grasp found."""
    margin_p50: float | None = None
    margin_p90: float | None = None
    epsilon_p10: float | None = None
    """Quantiles of epsilon at the nominal normals over the surface; 0: no grasp found."""
    epsilon_p50: float | None = None
    epsilon_p90: float | None = None
    epsilon_min_p10: float | None = None
    """Quantiles of the smallest epsilon over all tilts."""
    epsilon_min_p50: float | None = None
    epsilon_min_p90: float | None = None
    required_resolution_50: float | None = None
    """Coarsest sensor resolution below which half of the surface is S at the model's friction
    [rad]; 0: no resolution is fine enough."""
    required_resolution_80: float | None = None
    required_resolution_90: float | None = None
    grasps: tuple[BestGrasp, ...] = ()
    """Best distinct grasps, the best first."""
    search_angle: float | None = None
    """Half-angle of the searched cone [rad]."""
    repairs: str = ""
    warnings: str = ""
    seconds_reading: float | None = None
    seconds_labelling: float | None = None
    """Search, labels and epsilon."""
    seconds_writing: float | None = None
    seconds: float = 0.0
    """Total time [s]."""
    version: str = ""
    """Version of grasp3d."""
    method: int | None = None
    """Version of the method, which changes when labels of the same mesh change."""

    @classmethod
    def lost(cls, mesh: str, source: str, size: int | None, reason: str) -> "Row":
        """Row of a mesh whose process failed, or whose results are gone.

        Args:
            mesh: Name of the mesh.
            source: Its path or address.
            size: Size of its file.
            reason: What happened.
        """
        return cls(
            mesh=mesh,
            source=source,
            outcome=Outcome.LOST,
            error=f"{source}: {reason}",
            bytes=size,
            version=package_version(),
            method=METHOD,
        )


def in_unicode(row: Row) -> Row:
    """A row as tables can hold it: bytes of file names that are not Unicode are escaped."""
    text: dict[str, Any] = {
        name: as_unicode(value)
        for name, value in vars(row).items()
        if type(value) is str and not value.isascii()
    }
    return replace(row, **text) if text else row


class Summary(list[Row]):
    """Rows of a batch, one for each mesh, in the order of the meshes' names."""

    def to_table(self) -> Any:
        """Return a `pyarrow.Table` with the columns of the data set `summary/`."""
        return table_of_records(self, Row, {})

    def to_dataframe(self) -> Any:
        """Return `to_table` as a `pandas.DataFrame`.

        Raises:
            OutputError: pandas is not installed; the extra `grasp3d[pandas]` installs it.
        """
        return data_frame(self.to_table())
