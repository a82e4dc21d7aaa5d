"""What readings of poses have in common: how one is tried, told from others, and applied."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from grasp3d.arrays import Bools, Floats
from grasp3d.errors import ContactError
from grasp3d.grasps.poses import STAGES, GraspPoses
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.hand import Hand
from grasp3d.hand.jaws import Jaws, metres_per_unit
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh
from grasp3d.settings.lengths import METRES, Unit

SUSPICION, LEVEL = 0.01, 0.001
"""Levels of the sign tests, over the poses that fit with one of two readings only, at which a
reading must win against the stated one, divided by the number of readings, and against others."""

FITTING = 0.8
"""Fraction of the poses that fit the object from which no other reading is tried."""

PLAUSIBLE = 0.5, 2.5
"""Spread of the TCPs, in object sizes, with which lengths in another scale, or an origin that no
program has, are considered: where they are all at one point, all poses fit if one does."""

FAR = 20.0
"""Spread, in object sizes, from which lengths are surely in another unit."""

NAMES: dict[Unit, str] = {"m": "metres", "cm": "centimetres", "mm": "millimetres", "in": "inches"}

ROUNDING = 1e-9
"""Lengths [m] and scales that differ by less are the same."""

FRAME = "with --frame "
"""Words before a frame."""

TAKEN = ", which --frame auto takes,"
"""Words after another reading, if it is the one that is named."""

FACTORS = 0.1, 2.0, 10.0
"""Scales of lengths that are tried beside those of units and the one that a file states. None is
between 0.1 and 1: toward the object's middle more poses fit, too, if they only scatter."""

READING, SUSPECTED = "pose_reading", "suspected_reading"
"""Settings of poses that were read as they fit their object, or should be: the sentence on it."""

POSES = ("poses", *(f"{stage}_poses" for stage in STAGES))
POSTURES = ("posture", *(f"{stage}_posture" for stage in STAGES))
"""Fields of poses that a reading changes."""

Change = Callable[[Floats], Floats]
"""From poses as a file has them, shape (k, 4, 4), lengths in metres, to those that it would have
without a mistake."""


def same(values: Floats) -> Floats:
    """Poses, or postures, as they are."""
    return values


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseReading:
    """Another reading of poses, which explains them better than the stated one.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps.pose_readings import suspected_reading
        >>> from grasp3d.grasps.poses import GraspPoses
        >>> franka = grasp3d.ParallelGripper.preset("franka")
        >>> block = trimesh.creation.box([0.03, 0.5, 0.02])
        >>> block = grasp3d.load_mesh(block, unit="m")
        >>> poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (20, 1, 1))
        >>> poses[:, 1, 3] = np.linspace(-0.22, 0.22, 20)
        >>> poses[:, 2, 3] = 0.1034  # those of the hand's base
        >>> given = GraspPoses(poses=poses, unit="m", hand=franka)
        >>> reading = suspected_reading(block, given, franka)
        >>> reading.words, reading.fitting, reading.stated
        ('with --frame graspgen', 20, 0)
        >>> suspected_reading(block, reading.applied(given), franka) is None
        True
    """

    words: str
    """What is different, such as 'with --frame graspgen'."""
    best: "Alternative | None"
    """The reading; None: several fit as well, and none is meant."""
    fit: str
    """What is the case in poses that fit, such as 'the jaws close on the object'."""
    fitting: int
    """Number of poses that fit the object with this reading."""
    stated: int
    """The same as stated."""
    tried: int
    """Number of poses that were tried."""
    count: int
    """Number of poses that there are."""
    stated_frame: GripperFrame
    """Frame of the gripper that is stated."""
    hand: Hand
    """The gripper."""

    @property
    def frame(self) -> GripperFrame | None:
        """Frame of the gripper in which the file has the poses; None: it takes more than that."""
        return self.best.frame if self.best and self.best.can_be_applied else None

    def __str__(self) -> str:
        """Both readings with their counts, one sentence without a full stop."""
        sample = "" if self.tried == self.count else f", a sample of the {self.count}"
        frame = frame_words(self.stated_frame, self.hand)
        return (
            f"as stated ({frame}) {self.fit} in {self.stated} of {self.tried} "
            f"poses{sample}; {self.words} in {self.fitting}"
        )

    def applied(self, poses: GraspPoses) -> GraspPoses:
        """The poses in this reading.

        Args:
            poses: Those that were read as stated; their unit is known.

        Raises:
            ContactError: Several readings fit as well, or the unit is not known.
        """
        best = self.best
        if best is None or self.frame is None:
            raise ContactError(f"{self}: give the frame (--frame, in Python frame=...)")
        read = poses.in_unit("m")
        moved = read.changed(lambda one: best.applied(one, read, self.hand))
        settings = {**poses.settings, READING: str(self)}
        fields: dict[str, Any] = {name: best.posture(getattr(poses, name)) for name in POSTURES}
        fields |= {name: getattr(moved, name) for name in POSES}
        changed = replace(
            read.scaled(best.factor, "m"),
            **fields,
            gripper_frame=best.frame,
            settings=settings,
        )
        return changed.in_unit(poses.unit or "m")


@dataclass(frozen=True, eq=False)
class Alternative:
    """A reading of poses that is tried."""

    words: str
    frame: GripperFrame
    change: Change = same
    factor: float = 1.0
    """Of the lengths in the file."""
    series: bool = False
    """Whether the origin is one of a series, not one that programs have."""
    posture: Change = same
    """What else is different in the values of joints."""
    hand: Hand | None = None
    """The hand that the poses are of; None: that which is given."""
    size: float = 1.0
    """Factor of the size of the object."""

    @property
    def can_be_applied(self) -> bool:
        """Whether poses can be changed so that they are right."""
        return self.hand is None and self.size == 1.0

    def of(self, poses: GraspPoses, hand: Hand) -> Floats:
        """Poses of the TCP in this reading, of those in metres that were read as stated."""
        return self.applied(poses.poses, poses, hand)

    def applied(self, matrices: Floats, poses: GraspPoses, hand: Hand) -> Floats:
        """Some of the matrices of poses in this reading, as `of`, shape (k, 4, 4)."""
        moved = self.change is same and self.factor == 1.0  # the frame is what is different
        in_file = poses.gripper_frame if moved else self.frame
        back = np.linalg.inv(in_file.to_tcp(hand))
        at = np.eye(4) if poses.object_pose is None else poses.object_pose.matrix
        changed = self.change(at @ matrices @ back)
        changed[:, :3, 3] *= self.factor
        return np.asarray(np.linalg.inv(at) @ changed @ self.frame.to_tcp(hand))

    @property
    def is_length(self) -> bool:
        """Whether what is different is a length that no program states."""
        return self.series or self.factor != 1.0

    def kind(self, hand: Hand) -> tuple[str, str]:
        """What it has in common with readings that differ in the place of the origin only."""
        what = "" if self.words.startswith(FRAME) else self.words
        return what, frame_key(self.frame.to_tcp(hand)[:3, :3], hand)


@dataclass(frozen=True, eq=False)
class Tried:
    """A reading, and what the jaws touch with it."""

    reading: Alternative
    fits: Bools
    """Which poses fit, shape (k,)."""
    area: Floats
    """The smaller area that a jaw touches [mesh unit^2], shape (k,); 0 where they do not fit."""
    ahead: Floats
    """How far the contacts are before the TCP [m], shape (k,); nan where they do not fit."""

    @property
    def fitting(self) -> int:
        """How many fit."""
        return int(self.fits.sum())

    def fits_more(self, other: "Tried", level: float = LEVEL) -> bool:
        """Whether it wins the sign test of the poses that fit with one of the two only."""
        return wins(self.fits & ~other.fits, other.fits & ~self.fits, level)

    def touches_more(self, other: "Tried") -> bool:
        """Whether it wins the sign test of the areas that are touched."""
        more = self.area > (1.0 + ROUNDING) * other.area
        less = other.area > (1.0 + ROUNDING) * self.area
        return wins(more, less, LEVEL)

    def is_nearer(self, other: "Tried") -> bool:
        """Whether it wins the sign test of which has the contacts nearer to the TCP."""
        one, two = (np.abs(tried.ahead) for tried in (self, other))
        return wins(one < two - ROUNDING, two < one - ROUNDING, LEVEL)

    def beats(self, other: "Tried") -> bool:
        """Whether it wins one of the first two, and the other one neither."""
        wins = self.fits_more(other) or self.touches_more(other)
        return wins and not other.fits_more(self) and not other.touches_more(self)


def wins(one: Bools, two: Bools, level: float) -> bool:
    """Whether one of two wins a sign test at a level."""
    wins, losses = int(one.sum()), int(two.sum())
    return bool(binom.sf(wins - 1, wins + losses, 0.5) <= level) if wins else False


@dataclass(frozen=True, eq=False)
class Trial:
    """What readings are tried on."""

    fit: ClassVar[str]
    """What is the case in poses that fit."""

    mesh: ObjectMesh
    hand: Hand
    table: Table | None

    def alternatives(self, poses: GraspPoses, *, lengths: bool) -> Iterator[Alternative]:
        """All other readings of poses in metres, the most common mistakes first.

        Args:
            poses: The poses.
            lengths: Whether lengths in other units are considered, too.
        """
        raise NotImplementedError

    def last_alternatives(self, poses: GraspPoses, *, lengths: bool) -> Iterator[Alternative]:
        """Further readings, which are only tried if none of these is better, as they take longer.

        Args:
            poses: As above.
            lengths: As above.
        """
        del poses, lengths
        yield from ()

    def fits(self, poses: Floats, posture: Floats) -> tuple[Bools, Floats, Floats]:
        """Which poses fit, how much is touched, and how far before the TCP [m], shape (k,) each.

        Args:
            poses: Hand's frame to that of the mesh, shape (k, 4, 4) [mesh unit].
            posture: Values of the joints, shape (k, p).
        """
        raise NotImplementedError

    def spread(self, reading: Alternative, poses: GraspPoses) -> float:
        """Diagonal of the box around the TCPs, in sizes of the object."""
        positions = reading.of(poses, self.hand)[:, :3, 3]
        size = self.mesh.size * metres_per_unit(self.mesh)
        return float(np.linalg.norm(np.ptp(positions, axis=0))) / size

    def tells(self, reading: Alternative, poses: GraspPoses) -> bool:
        """Whether the TCPs are neither all at one point nor far apart."""
        return PLAUSIBLE[0] <= self.spread(reading, poses) <= PLAUSIBLE[1]

    def of(self, readings: Sequence[Alternative], poses: GraspPoses) -> list[Tried]:
        """Which poses fit with each reading."""
        changed = np.concatenate([reading.of(poses, self.hand) for reading in readings])
        changed[:, :3, 3] /= metres_per_unit(self.mesh)
        posture = np.concatenate([reading.posture(poses.posture) for reading in readings])
        fits, area, ahead = self.fits(changed, posture)
        rows = np.arange(len(changed)).reshape(len(readings), -1)
        return [
            Tried(
                reading,
                fits[row],
                np.where(fits[row], area[row], 0.0),
                np.where(fits[row], ahead[row], np.nan),
            )
            for reading, row in zip(readings, rows, strict=True)
        ]


def frame_words(frame: GripperFrame, hand: Hand) -> str:
    """What people know a frame as: hands with joints have no TCP."""
    if isinstance(hand, ArticulatedHand) and frame == FRAMES["tcp"]:
        return f"the frame of the hand's base, {hand.link_names[0]}"
    return repr(str(frame))


def framed(frame: GripperFrame, *, series: bool = False) -> Alternative:
    """The reading that the poses are in another frame of the hand."""
    return Alternative(f"{FRAME}{frame}", frame, same, series=series)


def changed_readings(
    mesh: ObjectMesh,
    poses: GraspPoses,
    hand: Hand,
    frames: Sequence[GripperFrame],
    *,
    lengths: bool,
) -> Iterator[Alternative]:
    """Readings with other rotations, and other lengths, in frames.

    Args:
        mesh: The object.
        poses: The poses in metres.
        hand: The hand.
        frames: The stated one, and others.
        lengths: Whether lengths in other units are considered, too.
    """
    changes = [(words, change, 1.0) for words, change in ROTATIONS]
    changes += [(words, same, factor) for words, factor in scales(mesh, poses) if lengths]
    for words, change, factor in changes:
        for frame in {frame_key(frame.to_tcp(hand), hand): frame for frame in frames}.values():
            yield Alternative(with_frame(words, frame, poses), frame, change, factor)


def with_frame(words: str, frame: GripperFrame, poses: GraspPoses) -> str:
    """Words for a reading that has another frame, too."""
    other = "" if frame == poses.gripper_frame else f" in the frame {str(frame)!r}"
    return f"{words}{other}{TAKEN}"


def frame_key(matrix: Floats, hand: Hand) -> str:
    """What two frames have in common that are the same: jaws are alike on both sides."""
    turned = matrix.copy()
    if isinstance(hand, Jaws) and tuple(np.round(matrix[:3, 0], 6)) < (0.0, 0.0, 0.0):
        turned[:3, :2] *= -1.0
    return str((np.round(turned, 6) + 0.0).tolist())


_UNITS: tuple[tuple[Unit, Unit], ...] = (
    ("mm", "m"), ("cm", "m"), ("in", "m"), ("m", "mm"), ("in", "mm"), ("mm", "in"),
)  # fmt: skip
"""Units that are taken for each other, the right one first."""


def scales(mesh: ObjectMesh, poses: GraspPoses) -> Iterator[tuple[str, float]]:
    """Lengths in other units than they were read in, or of the object in another scale."""
    units = {
        METRES[one] / METRES[two]: f"{NAMES[one]} instead of {NAMES[two]}" for one, two in _UNITS
    }
    scale = (poses.object_scale or 1.0) / metres_per_unit(mesh)
    for factor in dict.fromkeys([*units, scale, 1.0 / scale, *FACTORS]):
        if abs(factor - 1.0) > ROUNDING:
            other = f"those of an object of {1.0 / factor:.4g} times its size"
            yield f"if their lengths are {units.get(factor, other)}", factor


def turned(turn: Change) -> Change:
    """Poses whose rotations, shape (k, 3, 3), are others."""

    def change(poses: Floats) -> Floats:
        changed = poses.copy()
        changed[:, :3, :3] = turn(poses[:, :3, :3])
        return changed

    return change


def _reordered(*order: int) -> Change:
    """Rotations whose quaternions (x y z w) are taken in another order."""

    def turn(rotations: Floats) -> Floats:
        quaternions = Rotation.from_matrix(rotations).as_quat()
        return np.asarray(Rotation.from_quat(quaternions[:, order]).as_matrix())

    return turned(turn)


ROTATIONS: tuple[tuple[str, Change], ...] = (
    (
        "if their quaternions are in the order (w x y z) instead of (x y z w)",
        _reordered(1, 2, 3, 0),
    ),
    (
        "if their quaternions are in the order (x y z w) instead of (w x y z)",
        _reordered(3, 0, 1, 2),
    ),
    (
        "if the halves of their quaternions are exchanged, (z w x y) instead of (x y z w)",
        _reordered(2, 3, 0, 1),
    ),
    (
        "if their rotations are inverted: transposed, or with the opposite scalar of a quaternion",
        turned(lambda rotations: rotations.transpose(0, 2, 1)),
    ),
    (
        "if they are inverted: they may be poses of the object in the gripper's frame",
        lambda poses: np.asarray(np.linalg.inv(poses)),
    ),
)
