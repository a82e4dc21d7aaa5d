"""What is kept of one mesh: a line of the summary."""

from dataclasses import dataclass
from enum import StrEnum


class Outcome(StrEnum):
    """What came of a mesh."""

    LABELLED = "labelled"
    REFUSED = "refused"
    """It cannot be labelled as it is, and will not be until it or the settings change."""
    LOST = "lost"
    """Its process died, or took too much time or memory; the next run tries it again."""


@dataclass(frozen=True)
class Share:
    """Shares of the surface by area at one friction and sensor resolution."""

    friction: float
    sensor_resolution: float
    """Resolution alpha [rad]."""
    stable: float
    """S."""
    ambiguous: float | None
    """M; none where atan(friction) + alpha/2 exceeds the cone that was searched."""
    no_grasp_found: float | None
    """U; none as above."""


@dataclass(frozen=True)
class BestGrasp:
    """One of the best distinct grasps of a mesh."""

    critical_angle: float
    """Critical friction angle over the worst normals [rad]."""
    max_resolution: float
    """Coarsest sensor resolution below which it is S at the model's friction [rad]; 0: none."""
    epsilon: float
    """At the nominal normals."""
    opening: float
    """Largest distance between two contacts, in the mesh's unit."""
    points: tuple[tuple[float, float, float], ...]
    """Contacts, in the mesh's unit and frame."""
    normals: tuple[tuple[float, float, float], ...]
    """Outward unit normals there."""


@dataclass(frozen=True)
class Row:
    """One line of the summary; what is not known of a mesh that was not labelled is none."""

    mesh: str
    """How the mesh is called: its path below the folder that was given."""
    source: str = ""
    """The file, as it was given."""
    outcome: Outcome = Outcome.LABELLED
    error: str = ""
    """Why it was not labelled."""
    bytes: int | None = None
    """Size of the file."""
    stamp: str = ""
    """What the file system says of its state: with the same stamp it has the same content."""
    content: str = ""
    """SHA-256 of the file, and of files that it refers to."""
    key: str = ""
    """What the row rests on: content, settings and version of the method."""
    friction: float | None = None
    """Coulomb coefficient that it was labelled with."""
    sensor_resolution: float | None = None
    """Resolution alpha that it was labelled with [rad]."""
    fingers: int | None = None
    labels: str = ""
    """Labelled PLY, its path below the output folder."""
    fields: str = ""
    """Table of the vertices, likewise."""
    view: str = ""
    """What the report shows of the mesh, likewise."""
    thumbnail: str = ""
    """Its small picture, likewise."""
    vertices: int | None = None
    faces: int | None = None
    size: float | None = None
    """Diameter of the ball around the surface, in the mesh's unit."""
    unit: str | None = None
    closed: bool | None = None
    area: float | None = None
    volume: float | None = None
    """Enclosed volume; none where the surface is open."""
    center_mass: tuple[float, float, float] | None = None
    torque_scale: float | None = None
    """Length that torques in epsilon are divided by, in the mesh's unit."""
    stable: float | None = None
    """Share of the surface labelled S, by area."""
    ambiguous: float | None = None
    """Share labelled M."""
    no_grasp_found: float | None = None
    """Share labelled U."""
    critical_angle_p10: float | None = None
    """Quantiles of the critical friction angle over the surface [rad]; inf: no grasp found."""
    critical_angle_p25: float | None = None
    critical_angle_p50: float | None = None
    critical_angle_p75: float | None = None
    critical_angle_p90: float | None = None
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
    [rad]; 0: no sensor is fine enough."""
    required_resolution_80: float | None = None
    required_resolution_90: float | None = None
    shares: tuple[Share, ...] = ()
    """Over the grid of frictions and sensor resolutions."""
    grasps: tuple[BestGrasp, ...] = ()
    """Best distinct grasps, the best first."""
    search_angle: float | None = None
    """Half-angle of the cone that was searched [rad]."""
    repairs: str = ""
    warnings: str = ""
    seconds_reading: float | None = None
    seconds_labelling: float | None = None
    """Search, labels and epsilon."""
    seconds_writing: float | None = None
    seconds: float = 0.0
    """All of it [s]."""
    version: str = ""
    """Of grasp3d."""
    method: int | None = None
    """Version of the method: it changes where labels of the same mesh do."""


TIMINGS = frozenset({"seconds", "seconds_reading", "seconds_labelling", "seconds_writing"})
"""Columns that differ from run to run."""
