"""What is kept of many contacts that are evaluated in parts: numbers for a report, and the best."""

from dataclasses import dataclass, field

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.grasps.ranking import ranked_rows
from grasp3d.mesh import ObjectMesh
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable

BEST = 10
"""Best grasps that are kept of each part."""


@dataclass
class PartsSummary:
    """Numbers of the grasps of all parts so far."""

    mesh: ObjectMesh
    count: int = 0
    labels: Ints = field(default_factory=lambda: np.zeros(len(Label), dtype=np.int64))
    """Number of grasps of each label."""
    excluded: int = 0
    """Grasps with a contact outside the region."""
    largest_distance: float = 0.0
    """Of a contact from the surface, in the mesh's unit."""
    angles: list[Floats] = field(default_factory=list)
    """Critical angles of each part [rad]."""
    warnings: dict[str, None] = field(default_factory=dict)
    _numbers: list[Ints] = field(default_factory=list)
    _contacts: list[Floats] = field(default_factory=list)

    def add(self, grasps: GraspTable, contacts: Floats) -> None:
        """Add a part: its grasps, and their contacts as they were given, shape (b, n, 3)."""
        self.labels += np.bincount(grasps.label, minlength=len(Label))
        self.excluded += int(np.isinf(grasps.critical_angle).sum())
        self.largest_distance = max(self.largest_distance, float(grasps.distance.max()))
        self.angles.append(grasps.critical_angle.astype(np.float32))
        self.warnings |= dict.fromkeys(grasps.warnings)
        best = ranked_rows(grasps)[:BEST]
        self._numbers.append(self.count + best)
        self._contacts.append(contacts[best])
        self.count += grasps.size

    def best(self) -> tuple[Ints, Floats]:
        """Rows in the file, and contacts as given, of the best grasps of every part."""
        return np.concatenate(self._numbers), np.concatenate(self._contacts)
