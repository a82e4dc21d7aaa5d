"""The verdict on an object: whether it can be held reliably, and if not what would help."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from grasp3d.grasps.distinct import distance_of_distinct, distinct_rows
from grasp3d.grasps.ranking import ranked_rows
from grasp3d.hand.reach import Reachability
from grasp3d.quality.loads import Load
from grasp3d.quality.task_texts import TaskText
from grasp3d.stability.label import Label
from grasp3d.surface.holding import Holding
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason


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
        phrase = f"({task})" if is_text else f"against {what}"
        return cls(
            holds=enough if holding.case.decided else None,
            mass=None if pure else holding.mass,
            available=holding.available,
            needed=needed,
            payload=payload,
            task="in any orientation" if task == Load().task else phrase,
            resisted=what if pure else "",
            reason="" if math.isfinite(needed) else _why_not_held(holding),
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


def _why_not_held(holding: Holding) -> str:
    """Why no grasp holds a load at all normals."""
    if np.isnan(holding.grip_force_least).all():
        return "there is no grasp"
    if holding.remedy:
        return holding.remedy
    nominal = float(np.nanmin(holding.grip_force, initial=math.inf))
    if math.isfinite(nominal):
        return f"the sensor is too coarse; at the sensed normals {nominal:.3g} N are enough"
    return "no contact force resists the task"


Word = Literal["holdable", "with a finer sensor", "out of reach", "no"]

MOST_COUNTED = 1000
"""Distinct grasps that are counted at most."""

FINEST = math.radians(0.05)
"""Resolution [rad] that no sensor has: a grasp that needs a finer one is never S."""

STATES = {
    Reachability.WIDTH: "the openings are outside the stroke",
    Reachability.TIP: "the fingertips do not fit",
    Reachability.DIRECTION: "no approach direction is allowed",
    Reachability.TABLE: "the table is in the way",
    Reachability.BLOCKED: "fingers or palm touch the object",
}
"""Why grasps are not reached."""


@dataclass(frozen=True)
class Verdict:
    """Whether an object can be held reliably: by a gripper, or by ideal fingers without one.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps import verdict_of
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> labels = grasp3d.label_surface(grasp3d.load_mesh(box, unit="m", max_edge=0.02))
        >>> print(verdict_of(labels))
        holdable: 23 distinct grasps, the best with 30.5° of resolution to spare
    """

    word: Word
    """holdable: there is an S grasp; with a finer sensor: some grasp would be S; out of reach: the
    gripper reaches none of the grasps; no: no sensor makes any grasp S."""
    count: int
    """Distinct S grasps, of those that the gripper reaches; at most 1,000."""
    spare_resolution: float
    """Of the best grasp: alpha* - alpha [rad], what the sensor's resolution may still grow by;
    negative: it must be finer. nan: none could be S."""
    approach_margin: float
    """Of the best grasp [rad]: how wrong the approach angle may be; nan: none, or no gripper."""
    max_resolution: float
    """Of the best grasp: coarsest sensor resolution below which it is S [rad]; 0: none."""
    reason: str = ""
    """Out of reach, and no: why."""
    holding: HoldingVerdict | None = None
    """Whether the load is held; None: there is no load."""

    def __str__(self) -> str:
        return self.text if self.holding is None else f"{self.text}; {self.holding}"

    @property
    def text(self) -> str:
        """The sentence without that on the load."""
        if self.word == "holdable":
            grasps = "1 distinct grasp" if self.count == 1 else f"{self.count} distinct grasps"
            spare = f"the best with {math.degrees(self.spare_resolution):.1f}° of resolution"
            margin = ""
            if math.isfinite(self.approach_margin):
                margin = f" and ±{math.degrees(self.approach_margin):.0f}° of approach"
            return f"{self.word}: {grasps}, {spare}{margin} to spare"
        if self.word == "with a finer sensor":
            return f"{self.word} (resolution below {math.degrees(self.max_resolution):.1f}°)"
        if self.word == "no":
            return f"not holdable: {self.reason}"
        return f"{self.word} ({self.reason})" if self.reason else self.word


def verdict_of(labels: SurfaceLabels) -> Verdict:
    """Judge whether an object can be held reliably; computes epsilon, which ranks the grasps.

    With a load also whether it is held, which computes the grip forces.

    Args:
        labels: The labelled surface.

    Returns:
        The verdict on the grasps of the vertices; its best grasp is the first one of `best_grasps`
        unless a gripper's jaws, once closed, confirm others better.
    """
    verdict = _verdict(labels)
    if labels.holding is None:
        return verdict
    return replace(verdict, holding=HoldingVerdict.of(labels.holding))


def _verdict(labels: SurfaceLabels) -> Verdict:
    grasps, rows = labels.grasps, ranked_rows(labels.grasps)
    rows = rows[grasps.max_resolution[rows] > FINEST]
    if not len(rows):
        # Grasps that the gripper does not reach, or that exceed its stroke.
        reasons = labels.likely_reason[labels.mesh.on_surface]
        outside = Reason.OPENING if labels.scene is not None else Reason.NOT_REACHED
        if np.isin(reasons, [Reason.NOT_REACHED, outside]).any():
            return Verdict("out of reach", 0, math.nan, math.nan, 0.0, _reason(labels))
        why = "at no sensor resolution is a grasp S"
        if not (labels.likely_reason == Reason.FOUND).any():
            why = "no grasp was found"
        return Verdict("no", 0, math.nan, math.nan, 0.0, why)
    best = rows[0]
    resolution = float(grasps.max_resolution[best])
    stable = rows[grasps.label[rows] == Label.S]
    word: Word = "holdable" if len(stable) else "with a finer sensor"
    points = grasps.contacts.take(stable).points
    margin = math.nan if grasps.reach is None else float(grasps.reach.approach_margin[best])
    return Verdict(
        word,
        len(distinct_rows(points, MOST_COUNTED, distance_of_distinct(labels.mesh))),
        resolution - labels.model.sensor_resolution,
        margin,
        resolution,
    )


def _reason(labels: SurfaceLabels) -> str:
    """What keeps the gripper from most of the surface that has grasps."""
    areas, reasons = labels.mesh.vertex_areas, labels.likely_reason
    totals = np.zeros(len(Reachability))
    totals[Reachability.WIDTH] = areas[reasons == Reason.OPENING].sum()
    if labels.reach is not None:
        missed = reasons == Reason.NOT_REACHED
        totals += np.bincount(labels.reach.state[missed], areas[missed], len(Reachability))
    return STATES[max(STATES, key=lambda state: totals[state])]
