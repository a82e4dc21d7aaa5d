"""A hand of three straight fingers that slide around a ring and close radially onto its axis.

It is a `Hand` of another kind than a parallel gripper: another number of fingers, a posture, and
collision tests of its own, by distances between segments and triangles. It is known to files once
this module is imported.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import trimesh

from grasp3d.arrays import ArrayLike, Bools, Floats, locked
from grasp3d.errors import SettingError
from grasp3d.hand.closed_jaws import ClosedJaws, Closing, Touch
from grasp3d.hand.hand_files import READERS
from grasp3d.hand.reach import Reach, Reachability
from grasp3d.hand.table import Approach, Table
from grasp3d.hand.triangles import Part, Triangles, triangles_of
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import METRES
from grasp3d.settings.sampling import Grip

FORMAT = "test ring"
STEPS = 5
"""Radii at which the closing is tested."""

TOUCHING = 1e-7
"""Distance that counts as none, in object sizes."""

DEGENERATE = 1e-3
"""Largest sine between the sides of a triangle of contacts that are on one line."""


@dataclass(frozen=True)
class RingHand:
    """Three capsules parallel to z, with their ends in the plane z = 0, about the z axis [m].

    Finger 1 is in the direction x; the posture has the azimuths of the other two. The opening is
    the diameter of the circle that the fingers touch from outside.
    """

    name: str = "ring"
    max_opening: float = 0.08
    finger_radius: float = 0.004
    finger_length: float = 0.06
    compliance: float = 0.0005
    clearance: float = 0.002
    max_force: float | None = 20.0

    @property
    def fingers(self) -> tuple[int, ...]:
        return (3,)

    @property
    def limits(self) -> tuple[float, float]:
        return 0.0, self.max_opening - 2.0 * self.clearance

    @property
    def size(self) -> float:
        return self.finger_length + self.max_opening

    @property
    def resolution(self) -> float | None:
        return None

    @property
    def touch_area(self) -> float:
        return math.pi * self.finger_radius**2

    def torsion_radius(self, friction: float) -> float:
        del friction
        return 0.0

    def touching(self, model: GraspModel) -> GraspModel:
        return model

    def check_fingers(self, count: int) -> None:
        if count != 3:
            raise SettingError(f"{self.name} has three fingers, not {count}")

    def distances(self, grip: Grip) -> tuple[float, float]:
        del grip
        return 0.0, self.max_opening

    def shape(self, opening: float, posture: ArrayLike = ()) -> Triangles:
        azimuths = np.array([0.0, *np.asarray(posture, dtype=float)])
        radius = 0.5 * opening + self.finger_radius
        palm = trimesh.creation.cylinder(0.5 * self.max_opening + 2.0 * self.finger_radius, 0.01)
        palm.apply_translation([0.0, 0.0, -self.finger_length - 0.005])
        parts = [(Part.PALM, palm)]
        for azimuth in azimuths:
            finger = trimesh.creation.capsule(self.finger_length, self.finger_radius)
            top = -finger.bounds[1, 2] + self.finger_radius
            finger.apply_translation([*(radius * _direction(azimuth)[:2]), top])
            parts.append((Part.FINGER, finger))
        whole = trimesh.util.concatenate([mesh for _, mesh in parts])
        ids = np.concatenate([np.full(len(mesh.faces), part, np.uint8) for part, mesh in parts])
        return triangles_of(whole.vertices, whole.faces, ids)

    def opening_at(self, points: Floats, normals: Floats, internal: Bools, metres: float) -> Floats:
        del internal
        radius = self.finger_radius / metres
        centres = points + radius * normals
        return np.array([2.0 * (_circle(one)[1] - radius) for one in centres])

    def reach(
        self,
        mesh: ObjectMesh,
        points: ArrayLike,
        normals: ArrayLike,
        *,
        grip: ArrayLike = 1,
        table: Table | None = None,
        approach: Approach | None = None,
    ) -> Reach:
        del grip
        inside = _Beside(self, mesh, table, approach or Approach())
        centres = np.asarray(points) - inside.radius * np.asarray(normals)
        found = [inside.reach(one) for one in centres]
        states, poses, openings, postures = (list(column) for column in zip(*found, strict=True))
        reached = np.array([state == Reachability.REACHED for state in states])
        opening = np.where(reached, openings, math.nan)
        return Reach(
            state=locked(states, np.uint8),
            poses=locked(np.where(reached[:, None, None], poses, math.nan)),
            approach_margin=locked(np.where(reached, 0.0, math.nan)),
            opening=locked(opening),
            pregrasp_opening=locked(opening + 2.0 * inside.clearance),
            depth=locked(np.where(reached, 0.0, math.nan)),
            posture=locked(np.where(reached[:, None], postures, math.nan)),
            free=locked(np.zeros((len(states), 0), np.bool_)),
        )

    def close(
        self,
        mesh: ObjectMesh,
        poses: ArrayLike,
        *,
        posture: ArrayLike | None = None,
        object_motion: str = "fixed",
        friction: float = 0.5,
        give_way: float = 0.0,
    ) -> ClosedJaws:
        """Each finger moves onto the axis until it touches; the object stays where it is."""
        del object_motion, friction, give_way
        inside = _Beside(self, mesh, None, Approach())
        matrices = np.array(poses, dtype=float)
        joints = np.asarray(posture, dtype=float).reshape(len(matrices), 2)
        touched = [
            [inside.touch(pose, azimuth) for azimuth in (0.0, *azimuths)]
            for pose, azimuths in zip(matrices, joints, strict=True)
        ]
        radii = np.array([[one[0] for one in row] for row in touched])  # (k, 3)
        points = np.array([[one[1] for one in row] for row in touched])
        normals = np.array([[one[2] for one in row] for row in touched])
        touches, starts_inside = np.isfinite(radii), np.isinf(radii).any(axis=1)
        state = np.full(len(matrices), Closing.NOTHING, np.uint8)
        state[touches.any(axis=1)] = Closing.ONE_SIDE
        state[touches.all(axis=1)] = Closing.CLOSED
        state[starts_inside] = Closing.STARTS_INSIDE
        closed = state == Closing.CLOSED
        radii = np.where(touches, radii, math.nan)
        return ClosedJaws(
            state=locked(state),
            poses=locked(matrices),
            points=locked(points),
            normals=locked(normals),
            opening=locked(np.where(closed, 2.0 * (radii.mean(axis=1) - inside.radius), math.nan)),
            positions=locked(radii),
            area=locked(np.where(touches, 0.0, 0.0)),
            extents=locked(np.zeros((*radii.shape, 2))),
            corners=locked(np.repeat(points[:, :, None], 8, axis=2)),
            touch=locked(np.where(touches, Touch.POINT, Touch.NOTHING), np.uint8),
            apart=locked(np.zeros(len(state), np.bool_)),
            shift=locked(np.zeros(len(state))),
            turn=locked(np.zeros(len(state))),
        )

    def blocked(
        self,
        mesh: ObjectMesh,
        poses: Floats,
        closed: ClosedJaws,
        *,
        posture: ArrayLike | None = None,
        held: Bools,
        table: Table | None = None,
    ) -> Bools:
        inside = _Beside(self, mesh, table, Approach())
        joints = np.asarray(posture, dtype=float).reshape(len(poses), 2)
        found = []
        for row, pose in enumerate(poses):
            azimuths = (0.0, *joints[row])
            wide = np.full(3, inside.widest)
            radii = [closed.positions[row]] if held[row] else []
            free = inside.free(pose, azimuths, [wide, *radii], come_at=wide)
            found.append(not (free and inside.above_table(pose, azimuths, wide)))
        return np.array(found, dtype=np.bool_)

    def opens_to(self, mesh: ObjectMesh, closed: ClosedJaws) -> Bools:
        most = self.limits[1] / METRES[mesh.unit]
        return np.asarray(closed.opening <= most * (1.0 + 1e-9))

    def description(self) -> Mapping[str, Any]:
        return {"format": FORMAT, **asdict(self)}


class _Beside:
    """A ring hand beside an object, with lengths in the unit of the mesh."""

    def __init__(
        self, hand: RingHand, mesh: ObjectMesh, table: Table | None, approach: Approach
    ) -> None:
        scale = 1.0 / METRES[mesh.unit]
        self.radius, self.length = hand.finger_radius * scale, hand.finger_length * scale
        self.compliance, self.clearance = hand.compliance * scale, hand.clearance * scale
        self.widest = 0.5 * hand.max_opening * scale + self.radius
        self.most = hand.limits[1] * scale
        self.size, self.table, self.approach = mesh.size, table, approach
        self.triangles = mesh.vertices[mesh.faces]
        self.vertices = mesh.vertices[mesh.on_surface]

    def reach(self, centres: Floats) -> tuple[Reachability, Floats, float, Floats]:
        """State, pose, opening and posture with the ends of the fingers at given points (3, 3)."""
        middle, radius, normal = _circle(centres)
        opening = 2.0 * (radius - self.radius)
        states = []
        for z in self._best_first(normal):
            pose = np.eye(4)
            x = (centres[0] - middle) / radius
            pose[:3] = np.stack([x, np.cross(z, x), z, middle], axis=1)
            local = (centres - middle) @ pose[:3, :3]
            azimuths = np.arctan2(local[:, 1], local[:, 0])
            states.append(self._state(pose, azimuths, centres, radius, opening))
            if states[-1] == Reachability.REACHED:
                break
        return max(states, key=_ORDER.index), pose, opening, azimuths[1:]

    def _best_first(self, normal: Floats) -> list[Floats]:
        """Both approach directions along an axis, that nearer to the preferred one first."""
        down = self._down()
        return [normal, -normal] if down is None or normal @ down >= 0.0 else [-normal, normal]

    def _down(self) -> Floats | None:
        if self.approach.direction is None and self.table is not None:
            return -self.table.normal
        return self.approach.direction

    def _state(
        self, pose: Floats, azimuths: Floats, centres: Floats, radius: float, opening: float
    ) -> Reachability:
        if not 0.0 <= opening <= self.most:
            return Reachability.WIDTH
        gaps = np.linalg.norm(centres - np.roll(centres, 1, axis=0), axis=1)
        if gaps.min() < 2.0 * self.radius:  # fingers beside each other
            return Reachability.TIP
        down = self._down()
        if down is not None and pose[:3, 2] @ down < math.cos(self.approach.within) - 1e-9:
            return Reachability.DIRECTION
        came = np.full(3, radius + self.clearance)
        radii = [came - step for step in np.linspace(0.0, self.clearance, STEPS)]
        if not self.free(pose, azimuths, radii, come_at=came):
            return Reachability.BLOCKED
        held = self.above_table(pose, azimuths, np.full(3, radius))
        return Reachability.REACHED if held else Reachability.TABLE

    def free(
        self, pose: Floats, azimuths: ArrayLike, radii: list[Floats], *, come_at: Floats
    ) -> bool:
        """Whether fingers and palm are free of the object at some radii, and on their way there."""
        palm = pose[:3, 3] - self.length * pose[:3, 2]
        if ((self.vertices - palm) @ pose[:3, 2]).min() <= 0.0:
            return False
        far = self.length + 3.0 * self.size
        for number, azimuth in enumerate(np.asarray(azimuths)):
            ways = [(come_at[number], far), *((one[number], self.length) for one in radii)]
            for radius, length in ways:
                ends = self._ends(pose, azimuth, radius, length)
                if distance(ends, self.triangles)[0] < self.radius - self.compliance:
                    return False
        return True

    def above_table(self, pose: Floats, azimuths: ArrayLike, radii: Floats) -> bool:
        """Whether fingers and palm are above the table."""
        if self.table is None:
            return True
        ends = np.concatenate([
            self._ends(pose, azimuth, radius, self.length)
            for azimuth, radius in zip(np.asarray(azimuths), radii, strict=True)
        ])  # fmt: skip
        lowest = (ends @ self.table.normal).min() - self.radius
        sine = np.linalg.norm(np.cross(pose[:3, 2], self.table.normal))
        palm = (pose[:3, 3] - self.length * pose[:3, 2]) @ self.table.normal
        rim = palm - (self.widest + self.radius) * sine
        return bool(min(lowest, rim) >= self.table.offset - self.compliance)

    def touch(self, pose: Floats, azimuth: float) -> tuple[float, Floats, Floats]:
        """Radius at which a finger touches, where, and the normal there into the object.

        nan: it touches nothing; inf: it starts in the object.
        """
        nothing = np.full(3, math.nan)
        radius, first = self.widest, True
        while radius > 0.0:
            ends = self._ends(pose, azimuth, radius, self.length)
            gap, on_axis, on_object = distance(ends, self.triangles)
            gap -= self.radius
            if first and gap < -self.compliance:
                return math.inf, nothing, nothing
            if gap < TOUCHING * self.size:
                inward = on_object - on_axis
                return radius, on_object, inward / np.linalg.norm(inward)
            radius, first = radius - gap, False  # no nearer than that can it come to the object
        return math.nan, nothing, nothing

    def _ends(self, pose: Floats, azimuth: float, radius: float, length: float) -> Floats:
        """Ends of the axis of a finger, the lower one first, shape (2, 3)."""
        tip = radius * _direction(azimuth)
        local = np.stack([tip, tip - [0.0, 0.0, length]])
        return local @ pose[:3, :3].T + pose[:3, 3]


_ORDER = [
    Reachability.WIDTH, Reachability.TIP, Reachability.DIRECTION, Reachability.BLOCKED,
    Reachability.TABLE, Reachability.REACHED,
]  # fmt: skip
"""How near states are to being reached."""


def distance(ends: Floats, triangles: Floats) -> tuple[float, Floats, Floats]:
    """Distance of a segment (2, 3) from triangles (F, 3, 3), and the nearest points of both."""
    start, along = ends[0], ends[1] - ends[0]
    count = len(triangles)
    both = [np.tile(end, (count, 1)) for end in ends]
    pairs = [(end, trimesh.triangles.closest_point(triangles, end)) for end in both]
    corners, sides = triangles, np.roll(triangles, -1, axis=1) - triangles
    pairs += [_between(start, along, corners[:, k], sides[:, k]) for k in range(3)]
    normals = np.cross(sides[:, 0], -sides[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.einsum("ij,ij->i", corners[:, 0] - start, normals) / (normals @ along)
    crossing = start + np.clip(np.nan_to_num(t), 0.0, 1.0)[:, None] * along
    pairs.append((crossing, trimesh.triangles.closest_point(triangles, crossing)))
    one, other = (np.concatenate([pair[k] for pair in pairs]) for k in range(2))
    gaps = np.linalg.norm(one - other, axis=1)
    nearest = int(gaps.argmin())
    return float(gaps[nearest]), one[nearest], other[nearest]


def _between(p: Floats, d: Floats, q: Floats, e: Floats) -> tuple[Floats, Floats]:
    """Nearest points of a segment p + s d and of segments q + t e, (F, 3) each."""
    r = p - q
    a, f = d @ d, np.einsum("ij,ij->i", e, r)
    c, b, ee = r @ d, e @ d, np.einsum("ij,ij->i", e, e)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.clip(np.nan_to_num((b * f - c * ee) / (a * ee - b * b)), 0.0, 1.0)
        t = np.clip((b * s + f) / ee, 0.0, 1.0)
    s = np.clip((b * t - c) / a, 0.0, 1.0)
    return p + s[:, None] * d, q + t[:, None] * e


def _circle(points: Floats) -> tuple[Floats, float, Floats]:
    """Middle, radius and unit normal of the circle through three points (3, 3)."""
    a, b = points[1] - points[0], points[2] - points[0]
    normal = np.cross(a, b)
    square = float(normal @ normal)
    if square <= (DEGENERATE * np.linalg.norm(a) * np.linalg.norm(b)) ** 2:
        return points.mean(axis=0), math.inf, np.array([0.0, 0.0, 1.0])
    middle = points[0] + ((a @ a) * np.cross(b, normal) + (b @ b) * np.cross(normal, a)) / (
        2.0 * square
    )
    return middle, float(np.linalg.norm(points[0] - middle)), normal / math.sqrt(square)


def _direction(azimuth: float) -> Floats:
    return np.array([math.cos(azimuth), math.sin(azimuth), 0.0])


def ring_of(found: Mapping[str, Any]) -> RingHand:
    """The hand that a description states."""
    return RingHand(**{name: value for name, value in found.items() if name != "format"})


READERS[FORMAT] = ring_of

RING = RingHand()
SMALL_RING = replace(RING, name="small ring", max_opening=0.05)
