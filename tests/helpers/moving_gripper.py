"""A gripper that moves step by step, by python-fcl: the oracle for reported poses.

Unlike in `collisions`, nothing is swept. Fingers, palm and tips have the sizes of the description.
They move to the pose with the pre-grasp opening, straight from where their front is outside the
ball around the object, and then close.
"""

from collections.abc import Iterator

import fcl
import numpy as np

from grasp3d import ObjectMesh
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach import Reach
from grasp3d.hand.table import Table
from tests.helpers.collisions import Oracle

STEPS = 200
ROUNDING = 1e-6
"""Length by which parts are reduced on every side, in object sizes."""

Part = tuple[object, np.ndarray, np.ndarray]
"""An FCL geometry, and its lowest and highest corner in the gripper's frame."""


class MovingGripper:
    """A gripper beside an object that it may touch only with the compliance of its pads."""

    def __init__(self, mesh: ObjectMesh, hand: ParallelGripper, table: Table | None = None) -> None:
        self._oracle = Oracle(mesh.vertices - mesh.center, mesh.faces)
        self._mesh, self._gripper, self._table = mesh, hand, table
        self._radius = np.linalg.norm(mesh.vertices - mesh.center, axis=1).max()

    def _length(self, name: str) -> float:
        return float(getattr(self._gripper, name))

    def parts(self, opening: float, contact: float, grip: int) -> Iterator[Part]:
        """Yield the gripper's parts at an opening; pads yield by the opening at contact."""
        tip, thick = self._length("tip_radius"), self._length("finger_thickness")
        soft, end = self._length("compliance"), self._length("end")
        half, back = self._length("finger_width") / 2, end - self._length("finger_length")
        axis = opening / 2 + tip
        inner = axis - thick / 2 if tip else axis
        outer = inner + thick
        if grip > 0:
            inner = max(inner, contact / 2 + soft)
        else:
            outer = min(outer, contact / 2 + (2 * tip or thick) - soft)
        yield self._box((inner, -half, back), (outer, half, end))
        yield self._box((-outer, -half, back), (-inner, half, end))
        palm, wide = self._length("palm_thickness") / 2, self._length("palm_width") / 2
        yield self._box((-palm, -wide, back - self._length("palm_length")), (palm, wide, back))
        for side in (-1.0, 1.0) if tip else ():
            centre = np.array([side * axis, 0.0, 0.0])
            radius = tip - soft - ROUNDING * self._mesh.size
            yield fcl.Sphere(radius), centre - radius, centre + radius

    def _box(self, low: tuple[float, ...], high: tuple[float, ...]) -> Part:
        small = ROUNDING * self._mesh.size
        lowest, highest = np.array(low) + small, np.array(high) - small
        return fcl.Box(*(highest - lowest)), lowest, highest

    def collision(self, reach: Reach, row: int, grip: int = 1) -> str:
        """Return what the gripper meets on its way to a pose; empty if nothing."""
        pose, contact, wide = reach.poses[row], reach.opening[row], reach.pregrasp_opening[row]
        moved = pose.copy()
        front = self._length("end") + self._length("tip_radius") + self._radius
        outside = front + (pose[:3, 3] - self._mesh.center) @ pose[:3, 2]
        for back in np.linspace(max(outside, 0.0), 0.0, STEPS):
            moved[:3, 3] = pose[:3, 3] - back * pose[:3, 2]
            met = self._met(moved, wide, contact, grip)
            if met:
                return f"{met} at {back:.4g} before the pose"
        for opening in np.linspace(wide, contact, STEPS):
            met = self._met(pose, opening, contact, grip)
            if met:
                return f"{met} at an opening of {opening:.4g}"
        return ""

    def _met(self, pose: np.ndarray, opening: float, contact: float, grip: int) -> str:
        turn, origin = pose[:3, :3], pose[:3, 3]
        placed = pose.copy()
        placed[:3, 3] -= self._mesh.center
        for geometry, low, high in self.parts(opening, contact, grip):
            if self._oracle.meets(placed, iter([(geometry, np.eye(3), (low + high) / 2)])):
                return "object"
            if self._table is None:
                continue
            lowest = (origin + turn @ (low + high) / 2) @ self._table.normal
            if isinstance(geometry, fcl.Sphere):
                lowest -= (high - low)[0] / 2
            else:
                lowest -= np.abs(self._table.normal @ turn) @ (high - low) / 2
            if lowest < self._table.offset - ROUNDING * self._mesh.size:
                return "table"
        return ""
