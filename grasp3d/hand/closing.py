"""Closing the jaws of a gripper on an object: contacts and the patches that the jaws touch."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from grasp3d._kernels.jaws.closing import INSIDE, LEFT, TOUCHES, ClosedOn, close_on
from grasp3d._kernels.jaws.jaws import ROUNDING, Jaw
from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.jaws import IN_METRES, Corners, Jaws
from grasp3d.hand.pose_checks import checked_poses
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import check_choice
from grasp3d.system.context import report_progress, thread_count, unreported


class Closing(IntEnum):
    """Outcome of closing the jaws."""

    CLOSED = 0
    """Both jaws touch the object."""
    NOTHING = 1
    """The jaws reach their smallest opening before both touch, or neither touches at all."""
    ONE_SIDE = 2
    """Only one jaw touches."""
    STARTS_INSIDE = 3
    """A finger is inside the object, or overlaps it, before the jaws move."""
    SLIPS_OUT = 4
    """A free object slides out of the closing jaws."""


MEANING: dict[Closing, str] = {
    Closing.CLOSED: "both jaws touch the object",
    Closing.NOTHING: "the jaws close on nothing",
    Closing.ONE_SIDE: "only one jaw touches the object",
    Closing.STARTS_INSIDE: "a finger starts in the object",
    Closing.SLIPS_OUT: "the object slides out of the jaws",
}
"""Each state in words, as shown to users."""


@dataclass(frozen=True, eq=False)
class ClosedJaws:
    """Where the n fingers of a hand touch an object, a row for each pose.

    A parallel gripper has two fingers, its jaws. A finger that touches nothing has nan and an area
    of 0.
    """

    state: Bytes
    """`Closing` codes, shape (k,)."""
    poses: Floats
    """The gripper in the object's frame when the jaws are closed [m], shape (k, 4, 4): as given if
    the object is fixed. A free object has moved relative to the gripper, whose TCP is then midway
    between the jaws."""
    points: Floats
    """Contacts, in the mesh's frame, shape (k, n, 3): the centroids of the touched patches if the
    object is fixed, the centres of pressure if it is free."""
    normals: Floats
    """Unit normals into the object, means over the patches, shape (k, n, 3)."""
    opening: Floats
    """Distance between the pads, or the nearest points of round tips, when both first touch [m],
    shape (k,); nan unless CLOSED."""
    positions: Floats
    """Where the jaws stop: x of the pads, or of the foremost points of round tips, in the frame of
    `poses` [m], shape (k, n)."""
    area: Floats
    """Areas of the touched patches [m^2], shape (k, n)."""
    extents: Floats
    """Sizes of the touched patches along y and z of the gripper [m], shape (k, n, 2)."""
    corners: Floats
    """Points of each touched patch that are farthest in eight directions along the pad, in the
    mesh's frame, shape (k, n, 8, 3). Their convex hull lies within that of the patch."""
    shift: Floats
    """How far the gripper was moved along the closing axis, relative to the object, before the jaws
    closed, because a finger would have started inside it [m], shape (k,)."""
    turn: Floats
    """Angle by which the object has turned relative to the gripper [rad], shape (k,); 0 where it is
    fixed or has not moved."""

    __repr__ = short_repr

    @property
    def closed(self) -> Bools:
        """Whether both jaws touch the object, shape (k,)."""
        return locked(self.state == Closing.CLOSED)

    @property
    def offset(self) -> Floats:
        """How far the middle between the jaws is from the TCP, along x [m], shape (k,).

        A rigid hand whose jaws move symmetrically pushes the object this far along -x.
        """
        return locked(self.positions.mean(axis=1))

    def take(self, which: slice | Ints | Bools) -> "ClosedJaws":
        """The rows of the chosen poses."""
        return ClosedJaws(**{name: locked(values[which]) for name, values in vars(self).items()})


def closed_jaws(
    mesh: ObjectMesh, result: ClosedOn, start: Floats, shift: Floats, *, least: float, free: bool
) -> ClosedJaws:
    """Find the states, and convert everything to the mesh's frame.

    Args:
        mesh: The object.
        result: What the kernels found, in the normalised frame.
        start: The poses before the jaws closed, in that frame, shape (k, 3, 4).
        shift: As in `ClosedJaws` [m], shape (k,).
        least: Smallest opening [object sizes].
        free: Whether the object is free, and contacts are centres of pressure.
    """
    touches = result.outcome == TOUCHES
    opening = result.position[:, 1] - result.position[:, 0]
    state = np.full(len(touches), Closing.NOTHING, dtype=np.uint8)
    both = touches.all(axis=1)
    state[touches.any(axis=1) & ~both] = Closing.ONE_SIDE
    state[both & (opening >= least - ROUNDING)] = Closing.CLOSED
    state[(result.outcome == INSIDE).any(axis=1)] = Closing.STARTS_INSIDE
    state[(result.outcome == LEFT).any(axis=1)] = Closing.SLIPS_OUT
    visible = touches & np.isin(state, (Closing.CLOSED, Closing.ONE_SIDE))[:, None]
    hidden = np.where(visible, 1.0, math.nan)
    low, high = result.bounds[..., :2], result.bounds[..., 2:]
    points, poses = result.points, np.tile(np.eye(4), (len(state), 1, 1))
    if free:
        points = centres_of_pressure(points, low, high, result.poses)
    poses[:, :3] = result.poses
    poses[:, :3, 3] = mesh.from_normalized(poses[:, :3, 3])
    # The chord of a small angle keeps its digits.
    chords = np.linalg.norm(start[..., :3] - poses[:, :3, :3], axis=(1, 2))
    turn = 2.0 * np.arcsin(np.minimum(chords / math.sqrt(8.0), 1.0))
    return ClosedJaws(
        state=locked(state),
        poses=locked(poses),
        points=locked(mesh.from_normalized(points) * hidden[..., None]),
        normals=locked(result.normals * hidden[..., None]),
        opening=locked(np.where(state == Closing.CLOSED, opening, math.nan) * mesh.size),
        positions=locked(result.position * hidden * mesh.size),
        area=locked(np.where(visible, result.area, 0.0) * mesh.size**2),
        extents=locked(np.where(visible[..., None], high - low, 0.0) * mesh.size),
        corners=locked(mesh.from_normalized(result.corners) * hidden[..., None, None]),
        shift=locked(shift),
        turn=locked(turn),
    )


def centres_of_pressure(points: Floats, low: Floats, high: Floats, poses: Floats) -> Floats:
    """Centres of pressure of jaws on a free object that is in equilibrium between them.

    The forces of the two jaws are opposite and on one line. The centre of pressure lies somewhere
    in each patch; the patch's centroid is only an estimate of it. Where the patches overlap, seen
    along the closing axis, the jaws press along the line parallel to that axis that is nearest to
    both centroids; otherwise they press at the ends that are nearest to each other.

    Args:
        points: Centroids of the patches in the object's frame, shape (k, 2, 3).
        low: Smallest y and z of the patches in the gripper's frame, shape (k, 2, 2).
        high: Largest y and z.
        poses: The gripper's frame to the object's, shape (k, 3, 4).
    """
    turned, origin = poses[:, None, :, :3], poses[:, None, :, 3]
    local = ((points - origin)[..., None, :] @ turned)[..., 0, :]
    common = local[..., 1:].mean(axis=1, keepdims=True)
    first, last = low.max(axis=1, keepdims=True), high.min(axis=1, keepdims=True)
    common = np.clip(common, np.minimum(first, last), np.maximum(first, last))
    local[..., 1:] = np.clip(common, low, high)
    return np.asarray((turned @ local[..., None])[..., 0] + origin)


FOOTPRINT = 1.0 / 3.0
"""Depth of the surface that determines the normal at a pad, relative to the pad's smaller side.

A turn by the friction angle of a coefficient of 0.5 brings onto the pad what was deeper by 1/4 of
its side (contact in the pad's middle) to 1/2 (contact at its edge).
"""

NO_EDGE = (0.0, 0.0, 1.0)
"""Padding for faces that have fewer sides."""


def jaw_of(gripper: Jaws, scale: float) -> Jaw:
    """Shape of a gripper's jaws, as the kernels take it.

    Args:
        gripper: The gripper.
        scale: Object sizes in one metre.
    """
    faces = [np.array(face) * scale for face in inner_faces(gripper)]
    most = max(map(len, faces))
    edges = np.tile(NO_EDGE, (len(faces), most, 1))
    for row, face in zip(edges, faces, strict=True):
        row[: len(face)] = _edges(face)
    points = np.concatenate(faces)[:, 1:]
    return Jaw(
        planes=np.stack([  # coefficients of x = a + b y + c z, by least squares
            np.linalg.lstsq(np.column_stack([np.ones(len(face)), face[:, 1:]]), face[:, 0])[0]
            for face in faces
        ]),
        edges=edges,
        bounds=np.concatenate([points.min(axis=0), points.max(axis=0)]),
        radius=gripper.tip_radius * scale,
        depth=gripper.tip_radius * scale or float(-min(face[:, 0].min() for face in faces)),
        thickness=(gripper.tip_thickness or gripper.finger_thickness) * scale,
        compliance=gripper.compliance * scale,
        footprint=FOOTPRINT * min(gripper.pad_width, gripper.pad_height) * scale,
    )  # fmt: skip


def inner_faces(gripper: Jaws) -> tuple[Corners, ...]:
    """The faces with which finger 1 touches: `inner_faces`, or else the pad's rectangle [m].

    For a round tip it is the square around the tip, seen along x.
    """
    if gripper.inner_faces:
        return gripper.inner_faces
    tip = gripper.tip_radius
    y, z = (tip, tip) if tip else (0.5 * gripper.pad_width, 0.5 * gripper.pad_height)
    return (((0.0, -y, -z), (0.0, y, -z), (0.0, y, z), (0.0, -y, z)),)


def _edges(face: Floats) -> Floats:
    """Sides of a convex face (n, 3), seen along x: outward unit normals and positions (n, 3)."""
    points = face[:, 1:]
    along = np.roll(points, -1, axis=0) - points
    x, y = points.T
    counterclockwise = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) > 0.0
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) * (1.0 if counterclockwise else -1.0)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    # A surface that only grazes a side is not touched.
    return np.column_stack([outward, (outward * points).sum(axis=1) - ROUNDING])


FIXED = -1.0
"""Value of the friction for which the kernels keep the object fixed."""

CHUNK = 64
"""Most poses that one thread computes at a time."""


def close_jaws(
    mesh: ObjectMesh,
    poses: ArrayLike,
    hand: Jaws,
    *,
    object_motion: ObjectMotion = "fixed",
    friction: float = 0.5,
    give_way: float = 0.0,
) -> ClosedJaws:
    """Close the jaws of a gripper on an object.

    Each jaw moves along the closing axis until it touches. Flat pads are rectangles, or the
    `inner_faces` of the gripper; of the mesh faces opposite a pad, exactly the parts within its
    outline count. Round tips are balls. The patch that a jaw touches is the surface within the
    gripper's compliance beyond the first touch. The contact is the patch's centroid, and its normal
    is the mean of the interpolated normals there.

    A free object gives way first. Squeezed by the jaws, it turns about y and z and shifts along
    them until friction holds it. Without friction it moves until no small motion closes the jaws at
    a finite rate; an object held exactly along its longest axis stays. The motion is quasi-static,
    without inertia and weight. In equilibrium the forces of both jaws are on one line, so the
    contacts are the centres of pressure (`centres_of_pressure`). Normals are then means over the
    surface opposite the pad to a depth of a third of the pad's smaller side: its slope decides
    where the object goes when it rolls or slips a little.

    On a flat pad, centroid and normal are weighted by the area on the pad: each part of the pad
    presses equally hard along the closing axis, whatever slope is below it, so steep faces bear
    little, and faces parallel to the axis nothing. On a round tip, the weight is the surface's
    area.

    Args:
        mesh: The object, whose unit is known.
        poses: Matrices that take coordinates of the gripper's frame to the mesh's, translations in
            metres, shape (k, 4, 4), or (4, 4) for one.
        hand: The gripper.
        object_motion: free: the object gives way; fixed: it does not move.
        friction: Coulomb coefficient between the jaws and a free object.
        give_way: Largest shift along the closing axis where a finger would start inside the object
            [m]; see `ClosedJaws.shift`.

    Raises:
        SettingError: The unit of the mesh is not known, or a setting is outside its range.
        ContactError: A pose is not a rigid motion; see `checked_poses`.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.hand.closing import Closing, close_jaws
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> hand = ParallelGripper(
        ...     name="small", max_opening=0.08, pad_width=0.02, pad_height=0.01,
        ...     finger_thickness=0.01, finger_width=0.02, finger_length=0.05,
        ...     palm_thickness=0.1, palm_width=0.05, palm_length=0.05,
        ... )
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.05, 0.03]), unit="m")
        >>> jaws = close_jaws(box, np.eye(4), hand)
        >>> Closing(jaws.state[0]).name, jaws.opening.round(6).tolist()
        ('CLOSED', [0.06])
        >>> jaws.normals[0, :, 0].round(6).tolist(), (1e6 * jaws.area).round(3).tolist()
        ([1.0, -1.0], [[200.0, 200.0]])
    """
    check_choice("object_motion", object_motion, ObjectMotion)
    mesh.needs_metres(IN_METRES)
    scale, free_object = 1.0 / mesh.size, object_motion == "free"
    checked = checked_poses(poses)
    checked[:, :3, 3] = (checked[:, :3, 3] - mesh.center) / mesh.size
    matrices = np.ascontiguousarray(checked[:, :3])
    jaw, start = jaw_of(hand, scale), hand.max_opening / mesh.size
    coefficient = friction if free_object else FIXED
    surface, tree = mesh.contact_surface, mesh.face_tree

    def closed_from(poses: Floats) -> ClosedOn:
        count, result, starts = len(poses), _empty(len(poses)), np.full(len(poses), start)
        step = max(1, min(CHUNK, count // (2 * thread_count())))
        firsts = range(0, count, step)

        def work(first: int) -> None:
            last = min(first + step, count)
            close_on(surface, tree, poses, starts, coefficient, jaw, first, last, result)

        with ThreadPoolExecutor(thread_count()) as executor:
            for done, _ in enumerate(executor.map(work, firsts), start=1):
                report_progress(done / len(firsts))
        return result

    result, shift = closed_from(matrices), np.zeros(len(matrices))
    for move in ways(give_way / mesh.size) if give_way else ():
        rows = np.flatnonzero((result.outcome == INSIDE).any(axis=1))
        if not len(rows):
            break
        moved = matrices[rows]
        moved[:, :, 3] += move * moved[:, :, 0]
        with unreported():
            again = closed_from(moved)
        free = ~(again.outcome == INSIDE).any(axis=1)
        for values, others in zip(result, again, strict=True):
            values[rows[free]] = others[free]
        shift[rows[free]] = move * mesh.size
    least = hand.min_opening * scale
    return closed_jaws(mesh, result, matrices, shift, least=least, free=free_object)


WAYS = 4
"""Shifts in either direction by which an object may give way."""


def ways(most: float) -> list[float]:
    """Shifts along the closing axis by which an object may give way, the smallest first.

    Args:
        most: The largest shift.
    """
    steps = np.linspace(0.0, most, WAYS + 1)[1:].tolist()
    return [sign * step for step in steps for sign in (1.0, -1.0)]


def _empty(count: int) -> ClosedOn:
    return ClosedOn(
        poses=np.empty((count, 3, 4)),
        outcome=np.zeros((count, 2), dtype=np.int64),
        position=np.full((count, 2), math.nan),
        points=np.full((count, 2, 3), math.nan),
        normals=np.full((count, 2, 3), math.nan),
        area=np.zeros((count, 2)),
        bounds=np.zeros((count, 2, 4)),
        corners=np.full((count, 2, 8, 3), math.nan),
    )
