# ruff: noqa: ARG002, as the protocol has them
"""A hand unknown to the package: pincers, two points that close along x toward the TCP."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp3d.arrays import Bools, Floats, locked
from grasp3d.errors import SettingError
from grasp3d.hand.closing import ClosedJaws, Closing
from grasp3d.hand.triangles import Triangles, triangles_of
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.measures import Triangles as Surface
from grasp3d.mesh.surface_points import FaceRays
from tests.helpers import repairs, shapes

FORMAT = "pincers of the tests"


@dataclass(frozen=True)
class Pincers:
    """Points that start at a distance on both sides, and touch what is on their way."""

    name: str = "pincers"
    max_opening: float = 0.1
    fingers = (2,)
    finger_length = 0.05
    max_force, sensor_resolution, touch_area = 20.0, None, 1e-6
    fitting = "both points touch the object"

    @property
    def limits(self) -> tuple[float, float]:
        return 0.0, self.max_opening

    @property
    def size(self) -> float:
        return self.max_opening

    def torsion_radius(self, friction: float) -> float:
        return 0.0 * friction

    def check_fingers(self, count: int) -> None:
        if count != 2:
            raise SettingError("pincers have two points")

    def distances(self, grip: str) -> tuple[float, float]:
        return self.limits

    def shape(self, opening: float, posture: Any = ()) -> Triangles:
        tip = shapes.box((0.002, 0.002, self.finger_length))
        sides = (repairs.moved(tip, (side * 0.5 * opening, 0.0, -0.025)) for side in (-1.0, 1.0))
        return triangles_of(*repairs.joined(*sides))

    def reach(self, *_: Any, **__: Any) -> Any:
        raise SettingError("pincers are closed at given poses")

    def close(self, mesh: ObjectMesh, poses: Any, **_: Any) -> ClosedJaws:
        poses = np.asarray(poses)
        count, half = len(poses), 0.5 * self.max_opening
        points, normals = np.full((2, count, 2, 3), np.nan)
        triangles = Surface(mesh.vertices, mesh.faces)
        rays = FaceRays(mesh.vertices, mesh.faces)
        for jaw, side in enumerate((-1.0, 1.0)):
            starts = poses[:, :3, 3] + side * half * poses[:, :3, 0]
            along = -side * poses[:, :3, 0]
            face, far = rays.hits(starts.astype(np.float32), along.astype(np.float32))
            met = (face >= 0) & (far < half)
            points[met, jaw] = starts[met] + far[met, None] * along[met]
            normals[met, jaw] = triangles.normals[face[met]]
        touched = np.isfinite(points).all(axis=(1, 2))
        opening = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
        zeros = np.zeros((count, 2))
        return ClosedJaws(
            state=locked(np.where(touched, Closing.CLOSED, Closing.NOTHING).astype(np.uint8)),
            poses=locked(poses),
            points=locked(points),
            normals=locked(normals),
            opening=locked(opening),
            positions=locked(np.stack([-0.5 * opening, 0.5 * opening], axis=1)),
            area=locked(zeros),
            extents=locked(np.zeros((count, 2, 2))),
            corners=locked(np.repeat(points[:, :, None], 8, axis=2)),
            shift=locked(np.zeros(count)),
            turn=locked(np.zeros(count)),
        )

    def blocked(self, mesh: ObjectMesh, poses: Any, closed: ClosedJaws, **_: Any) -> Bools:
        return np.zeros(len(poses), dtype=np.bool_)

    def fits(self, mesh: ObjectMesh, poses: Any, posture: Any, *, table: Any = None) -> Bools:
        return self.close(mesh, poses).closed

    def opens_to(self, closed: ClosedJaws) -> Bools:
        return np.asarray(closed.opening <= self.max_opening)

    def description(self) -> dict[str, Any]:
        return {"format": FORMAT, "name": self.name, "max_opening": self.max_opening}


def pincers_of(content: dict[str, Any]) -> Pincers:
    return Pincers(content["name"], content["max_opening"])


def above(x: float, y: float) -> Floats:
    """A pose from above, at height 0, the middle of an object."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:2, 3] = x, y
    return pose
