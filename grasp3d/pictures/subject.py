"""The viewed surface, with the best grasp of each of its vertices if known."""

import math
from dataclasses import dataclass, replace

import numpy as np

from grasp3d.arrays import Floats, short_repr
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import ANGLE_ROUNDING, GraspModel, search_cone
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sweeps import vertex_weights
from grasp3d.surface.vertex_fields import Reason, SearchReport

NO_LABELS = "the surface has no labels: poses of a hand are shown"
"""Reason why a surface cannot be clicked or saved."""


@dataclass(frozen=True, eq=False)
class Subject:
    """Viewed labels, computed or from a file."""

    labels: SurfaceLabels
    name: str
    notes: tuple[str, ...] = ()
    """Warnings about the labels, one sentence each."""
    searched: float = math.pi
    """Largest friction angle and tilt for which the search went far enough [rad]."""
    given: GraspTable | None = None
    """The grasp on the surface, one row, shown until a vertex is inspected; None: no grasp."""
    poses: EvaluatedPoses | None = None
    """Poses of a hand, of which the first one is shown; the surface then has no labels."""

    __repr__ = short_repr

    def at(self, model: GraspModel) -> "Subject":
        """Return the same grasps at another friction and resolution, with as many fingers."""
        if model.fingers != self.labels.model.fingers:
            model = replace(model, fingers=self.labels.model.fingers)
        if model == self.labels.model:  # keeps what has been computed
            return self
        return replace(self, labels=self.labels.using(model=model))

    @property
    def mesh(self) -> ObjectMesh:
        """The surface of the labels."""
        return self.labels.mesh

    @property
    def model(self) -> GraspModel:
        """Friction, resolution and fingers of the labels."""
        return self.labels.model

    @property
    def cone(self) -> float:
        """Largest critical friction angle that was searched [rad]."""
        return math.pi if self.labels.mode == "scan" else self.labels.search.cone

    @property
    def weights(self) -> Floats:
        """Fraction of the area that belongs to each vertex, shape (V,)."""
        return vertex_weights(self.mesh, "area")

    @property
    def bounds(self) -> Floats:
        """Lowest and highest corner of the bounding box of the surface, shape (2, 3)."""
        points = self.mesh.vertices[self.mesh.on_surface]
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def covers(self, model: GraspModel) -> bool:
        """Whether the search went far enough for a model; False for given poses."""
        return self.poses is None and search_cone(model) <= self.searched + ANGLE_ROUNDING


def subject_of(labels: SurfaceLabels, name: str | None = None) -> Subject:
    """Return the subject for labels.

    Args:
        labels: The labels.
        name: Name of the object; None: the name of its file.
    """
    scanned = labels.mode == "scan"
    return Subject(
        labels,
        labels.mesh.report.source if name is None else name,
        notes=(*labels.warnings, *labels.mesh.region_notes, *_method_notes(labels)),
        searched=math.pi if scanned else max(labels.search.cone, search_cone(labels.model)),
    )


def _method_notes(labels: SurfaceLabels) -> tuple[str, ...]:
    """Return a note on labels that do not follow from thresholds."""
    note = (
        "its labels were computed from wrench hulls at extreme normals; the displayed ones are "
        "thresholds on the critical friction angle, which hold for every normal"
    )
    return () if labels.model.method == "exact" else (note,)


def subject_of_poses(grasps: EvaluatedPoses) -> Subject:
    """Return the object of evaluated poses, showing the first one; its surface has no labels.

    Args:
        grasps: The poses.
    """
    subject = subject_of_mesh(grasps.mesh, grasps.model, grasps.scene)
    return replace(subject, poses=grasps)


def subject_of_mesh(mesh: ObjectMesh, model: GraspModel, scene: Scene | None = None) -> Subject:
    """Return an object without labels.

    Args:
        mesh: The object.
        model: Friction and resolution.
        scene: Hand and table; None: no hand and no table.
    """
    count = len(mesh.vertices)
    labels = SurfaceLabels.of_vertices(
        mesh,
        model,
        angles=(np.full(count, math.inf), np.full(count, math.inf)),
        partner_points=SurfacePoints(np.zeros((count, 1), np.int64), np.zeros((count, 1, 3))),
        grip=np.zeros(count, np.int8),
        reason=np.full(count, Reason.SAME_POINT),
        sampling=None,
        mode="scan",
        search=SearchReport(cone=0.0),
        scene=scene,
    )  # fmt: skip
    return subject_of(labels)
