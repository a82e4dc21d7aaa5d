"""Audit of poses: whether far more of them fit their object if the file is read in another way."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d.arrays import Floats, Ints
from grasp3d.errors import ContactError
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.postures import matched
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import GripperFrame, frames_of
from grasp3d.hand.hand import Hand
from grasp3d.hand.link_contacts import links_fit
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh

FEWEST, TRIED, SCREENED, KEPT = 5, 200, 24, 8
"""Fewest poses that are audited, as fewer agree by chance; most poses that are tried; number of
poses with which all readings are tried; and number of readings that are then tried with all."""

TIMES, MORE, SHARE = 2, 4, 0.1
"""Another reading must fit at least `TIMES` times as many poses as the stated one, at least `MORE`
poses more, and more by at least `SHARE` of the poses that are tried."""

NAMED, RIVAL = 0.5, 0.8
"""A reading stands out if at least the fraction `NAMED` of the poses fits in it, and if in each
other reading fewer fit than the fraction `RIVAL` of these."""

SPREAD = 0.1, 10.0
"""Spread of the TCPs, in object sizes, beyond which lengths may be in another unit."""

READING, SUSPECTED = "pose_reading", "suspected_reading"
"""Settings that hold a sentence on the reading that was applied, or that seems the right one."""

READINGS = {READING: "--frame auto", SUSPECTED: "warning"}
"""What users see for these settings."""

UNCHANGED = "nothing is changed: no other reading stands out"
"""The sentence in `READING` where the poses were read as stated."""

UNITS = {
    0.001: "mm instead of m", 0.01: "cm instead of m", 0.0254: "inches instead of m",
    1000.0: "m instead of mm", 25.4: "inches instead of mm",
}  # fmt: skip
"""Other meanings of the lengths in a file, by the factor that corrects them."""


def _ordered(*order: int) -> Callable[[Rotation], Rotation]:
    """Return a function that puts the quaternion components x y z w in another order."""
    return lambda turned: Rotation.from_quat(turned.as_quat()[:, order])


ROTATIONS: dict[str, Callable[[Rotation], Rotation]] = {
    "": lambda turned: turned,
    "their quaternions in the order (w x y z) instead of (x y z w)": _ordered(1, 2, 3, 0),
    "their quaternions in the order (x y z w) instead of (w x y z)": _ordered(3, 0, 1, 2),
    "their rotations transposed": Rotation.inv,
}
"""Other meanings of the rotations in a file."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseReading:
    """Another reading of poses, in which far more of them fit the object than as stated.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.formats import GraspPoses
        >>> from grasp3d.grasps import audit_poses
        >>> franka = grasp3d.ParallelGripper.preset("franka")
        >>> block = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.5, 0.02]), unit="m")
        >>> poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (20, 1, 1))
        >>> poses[:, 1, 3] = np.linspace(-0.22, 0.22, 20)
        >>> poses[:, 2, 3] = 0.1034  # poses of the hand's base
        >>> given = GraspPoses(poses=poses, unit="m", hand=franka)
        >>> reading = audit_poses(block, given, franka)
        >>> str(reading.frame), reading.fitting, reading.stated
        ('graspgen', 20, 0)
        >>> audit_poses(block, reading.applied(given), franka) is None
        True
    """

    given: GraspPoses
    """The poses that were tried, as they were read [m]."""
    hand: Hand
    """The gripper."""
    frame: GripperFrame
    """Frame of the gripper in which the file has the poses."""
    rotation: str = ""
    """What the rotations mean instead, a key of `ROTATIONS`."""
    factor: float = 1.0
    """Factor that corrects the lengths, a key of `UNITS`; 1: the lengths are right."""
    fitting: int = 0
    """Number of poses that fit the object in this reading."""
    stated: int = 0
    """Number of poses that fit the object as stated."""
    stands_out: bool = True
    """Whether far fewer fit in all other readings."""

    def __str__(self) -> str:
        """Return both counts as one sentence without a full stop."""
        unit = f"their lengths in {UNITS[self.factor]}" if self.factor != 1.0 else ""
        place = "" if self.frame == self.given.gripper_frame else self.frame.words
        words = " and ".join(part for part in (place, self.rotation, unit) if part)
        taken = "" if words == f"--frame {self.frame}" else ", which --frame auto takes,"
        other = f"with {words}{taken} in {self.fitting}"
        if not self.stands_out:
            other = f"in several other readings, of which none stands out, in up to {self.fitting}"
        stated = f"as stated ('{self.given.gripper_frame}') {self.hand.fitting} in {self.stated}"
        return f"{stated} of {self.given.count} poses; {other}"

    def of(self, poses: Floats) -> Floats:
        """Poses of the TCP in this reading, from those that were read as stated, (k, 4, 4) [m]."""
        at = np.eye(4) if self.given.object_pose is None else self.given.object_pose.matrix
        in_file = at @ poses @ np.linalg.inv(self.given.gripper_frame.to_tcp(self.hand))
        turned = ROTATIONS[self.rotation](Rotation.from_matrix(in_file[:, :3, :3]))
        in_file[:, :3, :3] = turned.as_matrix()
        changed = np.linalg.inv(at) @ _longer(in_file, self.factor)
        return np.asarray(changed @ self.frame.to_tcp(self.hand))

    def applied(self, poses: GraspPoses) -> GraspPoses:
        """The poses in this reading.

        Args:
            poses: Poses that were read as stated, with a known unit.

        Raises:
            ContactError: This reading does not stand out, or the unit is not known.
        """
        if not self.stands_out:
            raise ContactError(f"{self}: give the frame (--frame, in Python frame=...)")
        longer = poses.in_unit("m").scaled(self.factor, "m")
        read = longer.changed(lambda each: self.of(_longer(each, 1.0 / self.factor)))
        settings = {**poses.settings, READING: str(self)}
        read = replace(read, gripper_frame=self.frame, settings=settings)
        return read.in_unit(poses.unit or "m")


def audit_poses(
    mesh: ObjectMesh, poses: GraspPoses, hand: Hand, *, table: Table | None = None
) -> PoseReading | None:
    """Count how many poses fit their object as stated and in other readings of their file.

    `Hand.fits` decides whether a pose of a gripper fits, `links_fit` for a hand with joints. Where
    no other reading is found, the search is repeated for poses at which the gripper also misses the
    table. The frames tried are those with a name, their axes with the TCP or the base as origin,
    and the stated frame turned by 90° about the approach direction; for a hand with joints, the
    frames of its links. Each is combined with quaternions in another order and with transposed
    rotations and, where the TCPs are far apart or coincide, with other units of length.

    Args:
        mesh: The object; its unit is known.
        poses: Poses as they were read; without a unit they are in that of the mesh's file.
        hand: The gripper.
        table: What the object stands on; None: nothing.

    Returns:
        Another reading, in which at least twice as many fit; None if there is none, or if there are
        fewer than five poses.
    """
    read = poses.on(mesh)
    read = matched(read, hand) if isinstance(hand, ArticulatedHand) else read
    read = read.take(_some(read.count, TRIED))
    if read.count < FEWEST:
        return None
    tables = dict.fromkeys((None, table))
    return next(filter(None, (_audited(mesh, read, hand, below) for below in tables)), None)


def _audited(
    mesh: ObjectMesh, read: GraspPoses, hand: Hand, table: Table | None
) -> PoseReading | None:
    """Reading of poses [m] in which far more fit beside a table; None if there is none."""
    count = read.count

    def fitting(readings: list[PoseReading], rows: Ints) -> Ints:
        in_object = np.concatenate([one.of(read.poses[rows]) for one in readings])
        posture = np.tile(read.posture[rows], (len(readings), 1))
        if isinstance(hand, ArticulatedHand):
            fits = links_fit(mesh, hand, in_object, posture)
        else:
            fits = hand.fits(mesh, in_object, posture, table=table)
        return np.asarray(fits.reshape(len(readings), -1).sum(axis=1))

    as_stated = PoseReading(given=read, hand=hand, frame=read.gripper_frame)
    stated = int(fitting([as_stated], np.arange(count))[0])
    enough = max(TIMES * stated, stated + MORE, stated + SHARE * count)
    if enough > count:
        return None
    others = list(_others(as_stated, mesh))
    few = fitting(others, _some(count, SCREENED))
    best: list[PoseReading] = [others[k] for k in np.argsort(-few, kind="stable")[:KEPT]]
    counts = fitting(best, np.arange(count))
    order: list[int] = np.argsort(-counts, kind="stable").tolist()
    first, *rivals = order
    if (most := int(counts[first])) < enough:
        return None
    far_fewer = counts[rivals] < min(RIVAL * most, most - MORE + 1)
    stands_out = most >= NAMED * count and bool(far_fewer.all())
    return replace(best[first], fitting=most, stated=stated, stands_out=stands_out)


def explained(
    mesh: ObjectMesh, poses: GraspPoses, hand: Hand, *, table: Table | None = None
) -> GraspPoses:
    """Poses in the reading that stands out, or as they are where none does.

    Args:
        mesh: The object; its unit is known.
        poses: As for `audit_poses`.
        hand: The gripper.
        table: What the object stands on; None: nothing.

    Returns:
        The poses; the setting `pose_reading` says in which reading.
    """
    reading = audit_poses(mesh, poses, hand, table=table)
    if reading and reading.stands_out:
        return reading.applied(poses.on(mesh))
    return replace(poses, settings={**poses.settings, READING: UNCHANGED})


def _others(stated: PoseReading, mesh: ObjectMesh) -> Iterator[PoseReading]:
    """Yield all other readings that differ at these poses, those of the stated frame first."""
    poses, seen = stated.given.poses, {_key(stated.of(stated.given.poses), stated.hand)}

    def is_plausible(in_object: Floats) -> bool:
        spread = float(np.linalg.norm(np.ptp(in_object[:, :3, 3], axis=0)))
        return SPREAD[0] <= spread / mesh.size <= SPREAD[1]

    # Where bases are too close together, TCPs are still as far apart as hands are long.
    in_file = poses @ np.linalg.inv(stated.frame.to_tcp(stated.hand))
    units = () if is_plausible(poses) and is_plausible(in_file) else UNITS
    for factor, rotation in product((1.0, *units), ROTATIONS):
        for frame in (stated.frame, *frames_of(stated.hand), *_turned(stated.frame)):
            one = replace(stated, frame=frame, rotation=rotation, factor=factor)
            key = _key(in_object := one.of(poses), stated.hand)
            if key not in seen and (factor == 1.0 or is_plausible(in_object)):
                seen.add(key)
                yield one


def _turned(frame: GripperFrame) -> Iterator[GripperFrame]:
    """Yield the stated frame turned by 90° about the approach direction, as jaws look alike."""
    if not (frame.link or frame.matrix):
        turn = frame.turn + 0.5 * np.pi
        yield replace(frame, turn=turn, name=f"{frame} turned by 90 degrees")


def _key(poses: Floats, hand: Hand) -> bytes:
    """Key that equal poses share; poses with exchanged jaws are equal."""
    closing = poses[:, :3, :1]
    closing = closing * closing.transpose(0, 2, 1) if hand.fingers else closing
    return (np.round(np.concatenate([closing, poses[:, :3, 2:]], axis=2), 6) + 0.0).tobytes()


def _longer(poses: Floats, factor: float) -> Floats:
    """Poses with their translations multiplied by a factor."""
    return poses * np.where(np.arange(4) == 3, [[factor]] * 3 + [[1.0]], 1.0)


def _some(count: int, most: int) -> Ints:
    """Indices of at most `most` of `count` poses, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))
