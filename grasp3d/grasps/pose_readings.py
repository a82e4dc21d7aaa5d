"""Other readings of poses: which mistake of a file would explain why the jaws do not close."""

from collections.abc import Callable, Iterator
from typing import get_args

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d.arrays import Bools, Bytes, Floats
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.hand import Hand
from grasp3d.hand.jaws import AXES, Jaws, metres_per_unit
from grasp3d.mesh import ObjectMesh
from grasp3d.settings.lengths import METRES, Unit
from grasp3d.system.context import unreported

FITTING = 0.5
"""Fraction of the poses that fit the object from which no other reading is tried."""

TRIED = 64
"""Poses that readings are tried with, spread evenly over all."""

FEWEST = 5
"""Poses below which nothing is suspected: too few agree by chance."""

LEAST_FIT, LEAST_GAIN, LEAST_RATIO = 0.3, 0.25, 2.0
"""A reading is suspected if this fraction of the poses fits with it, by so much more, and by this
factor."""

PLAUSIBLE = 0.1, 2.5
"""Spread of the TCPs, in object sizes, with which the unit is not suspected: in a larger unit they
are all at one point, where all poses fit if one does."""

NAMES: dict[Unit, str] = {"m": "metres", "cm": "centimetres", "mm": "millimetres", "in": "inches"}

Change = Callable[[Floats], Floats]
"""From poses as they were read, shape (k, 4, 4), to those that they would be without a mistake."""

Reading = tuple[str, Change]
"""Completes 'the jaws would close ... in n of m poses ', and the poses of this reading."""


def suspected_reading(
    mesh: ObjectMesh,
    poses: Floats,
    hand: Hand,
    *,
    posture: Floats | None = None,
) -> str | None:
    """What mistake in a file of poses would explain that few of them fit the object.

    A pose fits if the gripper, wide open, approaches it without collision and its jaws then close
    on the object. Tried are quaternions in another order, rotations or poses that are inverted,
    lengths in other units, the hand's base instead of the TCP, and other axes.

    Args:
        mesh: The object; its unit is known.
        poses: TCP frame to the mesh's frame, translations in the mesh's unit, shape (k, 4, 4).
        hand: The gripper.
        posture: Further joints of the hand, shape (k, p); None: it has none.

    Returns:
        One sentence; None: enough poses fit, there are too few of them, or no reading is better.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps.pose_readings import suspected_reading
        >>> from grasp3d.hand.parallel_gripper import preset
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (5, 1, 1))
        >>> suspected_reading(box, poses, preset("franka")) is None
        True
        >>> poses[:, 1, 3] = np.linspace(-0.01, 0.01, 5)
        >>> poses[:, 2, 3] = 0.1034  # the hand's base
        >>> print(suspected_reading(box, poses, preset("franka")))
        the jaws close on the object without collision in 0 of 5 poses, but ...
    """
    if len(poses) < FEWEST:
        return None
    rows = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), TRIED)).astype(np.int64))
    tried, joints = poses[rows], np.zeros((len(rows), 0))
    if posture is not None:
        joints = posture[rows]
    count = int(_fits(mesh, tried, joints, hand).sum())
    if count >= FITTING * len(tried):
        return None
    spread = float(np.linalg.norm(np.ptp(tried[:, :3, 3], axis=0)))  # diagonal of the TCPs' box
    plausible = PLAUSIBLE[0] <= spread / mesh.size <= PLAUSIBLE[1]
    readings = list(_readings(mesh, hand, None if plausible else mesh.unit))
    changed = np.concatenate([change(tried) for _, change in readings])
    joints = np.tile(joints, (len(readings), 1))
    fitting = _fits(mesh, changed, joints, hand).reshape(len(readings), -1).sum(axis=1)
    best = int(fitting.max())
    enough = max(LEAST_FIT * len(tried), count + LEAST_GAIN * len(tried), LEAST_RATIO * count)
    if best < enough:
        return None
    sample = "" if len(tried) == len(poses) else f", a sample of the {len(poses)}"
    return (
        f"the jaws close on the object without collision in {count} of {len(tried)} poses{sample}, "
        f"but in {best} of them {readings[int(fitting.argmax())][0]}"
    )


def starting_inside(state: Bytes) -> str | None:
    """What suggests that most poses are too deep, from `Closing` codes (k,): one sentence."""
    inside = int((state == Closing.STARTS_INSIDE).sum())
    if len(state) < FEWEST or 2 * inside <= len(state):
        return None
    return (
        f"a finger starts in the object in {inside} of {len(state)} poses, even wide open: is the "
        "origin of the poses the point between the fingertips, is the unit of mesh and poses "
        "right, and is the object narrower than the stroke there?"
    )


def _fits(mesh: ObjectMesh, poses: Floats, posture: Floats, hand: Hand) -> Bools:
    """Whether the open gripper approaches each pose freely, and its jaws close there, (k,)."""
    with unreported():
        closed = hand.close(mesh, poses, posture=posture)
    open_wide = np.zeros(len(poses), dtype=np.bool_)
    blocked = hand.blocked(mesh, poses, closed, posture=posture, held=open_wide)
    return np.asarray(closed.closed & ~blocked)


def _readings(mesh: ObjectMesh, hand: Hand, unit: Unit | None) -> Iterator[Reading]:
    """All other readings, the most common mistakes first."""
    bases = _bases(hand, metres_per_unit(mesh))
    for how, change in (*_ROTATIONS, *_units(unit)):
        for frame in (np.eye(4), *bases):  # files state the pose of the TCP, or of the hand's base
            yield how, _in_frame(change, frame)
    behind = hand.base_to_tcp if isinstance(hand, Jaws) else 0.0
    distance = f"{1000.0 * behind:.4g} mm"
    for base in bases:
        how = (
            f"if they are those of the hand's base, {distance} behind the TCP: they may have been "
            "read as poses of the TCP"
        )
        yield how, _after(np.asarray(np.linalg.inv(base), dtype=np.float64))
        how = (
            f"if the TCP is {distance} farther back: poses of the TCP may have been read as those "
            "of the hand's base, or converted twice"
        )
        yield how, _after(base)
    for how, axes in _AXES:
        frame = np.eye(4)
        frame[:3, :3] = np.stack([AXES[name] for name in axes], axis=1)
        yield how, _after(frame)


def _bases(hand: Hand, metres: float) -> list[Floats]:
    """Frames of the hand's base to the TCP's [mesh unit]: with its own axes, with those of the TCP.

    Data sets have the axes of the TCP, robots those of the hand's description.
    """
    if not isinstance(hand, Jaws):
        return []
    own = hand.base_pose
    own[:3, 3] /= metres
    turned = np.eye(4)
    turned[:3, 3] = own[:3, 3]
    bases: list[Floats] = []
    for base in (own, turned):
        if not any(np.array_equal(base, other) for other in (np.eye(4), *bases)):
            bases.append(base)
    return bases


def _in_frame(change: Change, frame: Floats) -> Change:
    """The change of poses of another frame of the hand, from the TCP's to that frame."""
    back = np.linalg.inv(frame)
    return lambda poses: np.asarray(change(poses @ frame) @ back)


def _after(motion: Floats) -> Change:
    return lambda poses: np.asarray(poses @ motion)


def _units(unit: Unit | None) -> Iterator[Reading]:
    """Lengths in other units than they were read in."""
    if unit is None:
        return
    for other in get_args(Unit):
        if other != unit:
            words = f"if their lengths are {NAMES[other]} instead of {NAMES[unit]}"
            yield f"{words}: give the unit of the poses", _scaled(METRES[other] / METRES[unit])


def _scaled(factor: float) -> Change:
    factors = np.ones((4, 4))
    factors[:3, 3] = factor
    return lambda poses: poses * factors


def _turned(turn: Change) -> Change:
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

    return _turned(turn)


_ROTATIONS: tuple[Reading, ...] = (
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
        _turned(lambda rotations: rotations.transpose(0, 2, 1)),
    ),
    (
        "if they are inverted: they may be poses of the object in the gripper's frame",
        lambda poses: np.asarray(np.linalg.inv(poses)),
    ),
)

_AXES = (
    ("if their y is the closing axis, where x is expected", ("y", "-x", "z")),
    ("if they approach along -z, where z is expected", ("x", "-y", "-z")),
    (
        "if they approach along x and close along y, where z and x are expected",
        ("y", "z", "x"),
    ),
)
"""Other axes of the gripper's frame: x, y and z of the TCP as axes of the file's frame."""
