"""The verdict on an object under a load: whether it is held, or what that would take."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.loads import Load
from grasp3d.quality.task_texts import TaskText
from grasp3d.surface.holding import Holding


@dataclass(frozen=True)
class HoldingVerdict:
    """Whether some grasp holds a load at all normals that the sensor cannot distinguish.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps import verdict_of
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> model = grasp3d.GraspModel(torsion_radius="3mm", sensor_resolution=0.2)
        >>> for force in (40.0, 5.0):
        ...     load = grasp3d.Load(mass=0.5, grip_force=force)
        ...     print(verdict_of(grasp3d.label_surface(mesh, model, load=load)).holding)
        holds 0.5 kg at 40 N in any orientation
        needs 8... N; 5 N hold 0.3... kg
    """

    holds: bool | None
    """Whether some grasp does; None: the mass or the force at hand is not known."""
    mass: float | None
    """Mass of the object [kg]; None: not known, or it does not matter."""
    available: float | None
    """Force at hand of each finger [N]; None: not known."""
    needed: float
    """Grip force of the best grasp at its worst normals [N], for the mass or, if none is known, for
    1 kg; inf: no grasp holds the load."""
    payload: float
    """Largest mass that a grasp holds with the force at hand at its worst normals [kg]; nan: no
    force is known, or the task does not depend on the mass."""
    task: str = ""
    """What is resisted, in words after a verb."""
    resisted: str = ""
    """The task, if the mass has no part in it; else empty."""
    reason: str = ""
    """Why no grasp holds the load; empty where one does."""

    @classmethod
    def of(cls, holding: Holding) -> "HoldingVerdict":
        """The verdict on grasps.

        Args:
            holding: Forces and payloads of all grasps of an object.
        """
        forces = holding.grip_force_largest
        needed = float(np.nanmin(forces, initial=math.inf)) + 0.0  # 0, not -0
        payload = math.nan
        if holding.has_payload:
            payload = float(np.nanmax(holding.payload, initial=0.0))
        enough = None if holding.available is None else needed <= holding.available
        task, pure = holding.load.task, holding.task.mass is None
        is_text = isinstance(task, TaskText)
        what = str(task) if is_text else "the given task"
        given = f"({task})" if is_text else f"against {what}"
        return cls(
            holds=enough if holding.case.decided else None,
            mass=None if pure else holding.mass,
            available=holding.available,
            needed=needed,
            payload=payload,
            task="in any orientation" if task == Load().task else given,
            resisted=what if pure else "",
            reason="" if math.isfinite(needed) else _reason(holding),
        )

    def __str__(self) -> str:
        if self.reason:
            return f"no grasp surely holds the load ({self.reason})"
        if self.holds:
            if self.resisted:
                return f"resists {self.resisted} at {self.available:.3g} N"
            return f"holds {self.mass:.3g} kg at {self.available:.3g} N {self.task}"
        needs = f"needs {self.needed:.3g} N"
        if self.holds is None:
            return self._without_answer(needs)
        if math.isnan(self.payload):
            return f"{needs}; {self.available:.3g} N are at hand"
        return f"{needs}; {self.available:.3g} N hold {self.payload:.3g} kg"

    def _without_answer(self, needs: str) -> str:
        """The sentence where the mass or the force at hand is not known."""
        if self.available is not None:
            return f"{self.available:.3g} N hold {self.payload:.3g} kg {self.task}"
        if self.resisted:
            return f"{needs} {self.task}"
        what = f"{self.mass:.3g} kg" if self.mass is not None else "each kilogram"
        return f"{what} {needs} {self.task}"


def _reason(holding: Holding) -> str:
    """Why no grasp holds a load at all normals."""
    if np.isnan(holding.grip_force_least).all():
        return "there is no grasp"
    if holding.remedy:
        return holding.remedy
    nominal = float(np.nanmin(holding.grip_force, initial=math.inf))
    if math.isfinite(nominal):
        return f"the sensor is too coarse; at the sensed normals {nominal:.3g} N are enough"
    return "no contact force resists the task"
