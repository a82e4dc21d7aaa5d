"""Collisions of grippers by python-fcl: the oracle for the kernels.

FCL takes meshes as surfaces, so a box inside a solid does not collide with it. So parts are swept
out of the object, as in the kernels.
"""

from collections.abc import Iterator

import fcl
import numpy as np

from grasp3d.hand.parallel_gripper import ParallelGripper

FAR = 4.0
"""Length of swept parts, in object sizes."""

LENGTHS = (
    "finger_thickness", "finger_width", "finger_length", "palm_thickness", "palm_width",
    "compliance", "clearance", "tip_radius", "end",
)  # fmt: skip

SIDEWAYS = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotation that turns z, the axis of FCL's capsules, into x."""


def _box(low: tuple[float, ...], high: tuple[float, ...], grow: float) -> tuple:
    sizes = np.array(high) - low + 2.0 * grow
    if not (sizes > 0.0).all():
        return None, None, None
    return fcl.Box(*sizes), np.eye(3), (np.array(low) + high) / 2.0


def swept_parts(
    hand: ParallelGripper,
    opening: float,
    scale: float,
    *,
    grip: int = 1,
    grow: float = 0.0,
    far: float = FAR,
    opened: bool = True,
) -> Iterator[tuple]:
    """Yield fingers, palm and tips as FCL geometries, with rotations and positions in the hand.

    Args:
        hand: A gripper, in metres.
        opening: Distance between the inner faces or tips, in object sizes.
        scale: Object sizes per metre.
        grip: +1 external, -1 internal.
        grow: Length by which parts are enlarged on every side.
        far: Length behind the front end.
        opened: Whether the path of the fingers to their clearance is included.
    """
    g = {name: getattr(hand, name) * scale for name in LENGTHS}
    radius, thick, clear = g["tip_radius"], g["finger_thickness"], g["clearance"] * opened
    axis = opening / 2 + radius
    inner = axis - thick / 2 if radius else axis
    outer = inner + thick
    if grip > 0:
        inner, outer = max(inner, opening / 2 + g["compliance"]), outer + clear
    else:
        plane = opening / 2 + (2 * radius or thick)
        inner, outer = inner - clear, min(outer, plane - g["compliance"])
    half, end, palm = g["finger_width"] / 2, g["end"], g["palm_thickness"] / 2
    back, wide = end - g["finger_length"], g["palm_width"] / 2
    yield _box((-outer, -half, -far), (-inner, half, end), grow)
    yield _box((inner, -half, -far), (outer, half, end), grow)
    yield _box((-palm, -wide, -far), (palm, wide, back), grow)
    radius += grow - g["compliance"]
    if not g["tip_radius"] or radius <= 0.0:
        return
    for side in (-1.0, 1.0):
        near, out = side * axis, side * (axis + grip * clear)
        for x in {near, out}:
            yield fcl.Capsule(radius, far), np.eye(3), np.array([x, 0.0, -far / 2])
        if clear:
            yield fcl.Capsule(radius, clear), SIDEWAYS, np.array([(near + out) / 2, 0.0, 0.0])
            low, high = min(near, out), max(near, out)
            yield _box((low, grow - radius, -far), (high, radius - grow, -grow), grow)


class Oracle:
    """A surface in FCL."""

    def __init__(self, points: np.ndarray, faces: np.ndarray) -> None:
        self._model = fcl.BVHModel()
        self._model.beginModel(len(faces), len(points))
        self._model.addSubModel(np.asarray(points), np.asarray(faces))
        self._model.endModel()
        self._object = fcl.CollisionObject(self._model, fcl.Transform())
        self._request = fcl.CollisionRequest(num_max_contacts=1, enable_contact=False)

    def meets(self, pose: np.ndarray, parts: Iterator[tuple]) -> bool:
        """Whether one of the parts, in the frame of a pose, meets the surface."""
        for geometry, rotation, position in parts:
            if geometry is None:
                continue
            turn, origin = pose[:3, :3], pose[:3, 3]
            transform = fcl.Transform(turn @ rotation, turn @ position + origin)
            body = fcl.CollisionObject(geometry, transform)
            if fcl.collide(body, self._object, self._request, fcl.CollisionResult()):
                return True
        return False

    def collides(
        self,
        pose: np.ndarray,
        opening: float,
        hand: ParallelGripper,
        scale: float,
        *,
        grip: int = 1,
        slack: float = 1e-6,
    ) -> bool | None:
        """Whether swept parts at a pose meet the surface; None if within `slack` of touching."""
        large, small = (
            self.meets(pose, swept_parts(hand, opening, scale, grip=grip, grow=grow))
            for grow in (slack, -slack)
        )
        return large if large == small else None
