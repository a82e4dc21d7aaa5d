"""What a grip force needs besides the contacts, for a batch of grasps or some of it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, Ints
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.force_problem import ForceBound
from grasp3d.quality.grip_forces import (
    GripForce,
    force_with_lengths,
    grip_force,
    masses_of,
    wrenches_of,
)
from grasp3d.quality.tasks import Task


@dataclass(frozen=True, eq=False)
class ForceOptions:
    """What `grip_force` takes besides the contacts, for a batch or some of it."""

    task: Task | ArrayLike
    bound: ForceBound
    masses: ArrayLike | None
    rtol: float
    threads: int | None

    def flat(self, contacts: Contacts) -> "ForceOptions":
        """With one wrench and one mass for each grasp of a flat batch."""
        task = self.task if isinstance(self.task, Task) else wrenches_of(self.task, contacts)
        masses = None if self.masses is None else masses_of(self.masses, contacts)
        return replace(self, task=task, masses=masses)

    def take(self, rows: slice | Ints) -> "ForceOptions":
        """Those of chosen grasps."""
        task = self.task if isinstance(self.task, Task) else np.asarray(self.task)[rows]
        masses = None if self.masses is None else np.asarray(self.masses)[rows]
        return replace(self, task=task, masses=masses)

    def force(self, contacts: Contacts) -> GripForce:
        """Grip force of the contacts."""
        return grip_force(contacts, self.task, **self._keywords(), bound=self.bound)

    def force_of_lengths(self, contacts: Contacts, offset: Floats) -> GripForce:
        """Grip force with the forces' lengths, or their sum, bounded, at cones of other angles."""
        return force_with_lengths(
            contacts, self.task, **self._keywords(), bound=self.bound, cone_offset=offset
        )

    def coarse(self, rtol: float) -> "ForceOptions":
        """With another tolerance."""
        return replace(self, rtol=rtol)

    def _keywords(self) -> dict[str, Any]:
        return {"masses": self.masses, "rtol": self.rtol, "threads": self.threads}
