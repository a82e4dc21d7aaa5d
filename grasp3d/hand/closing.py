"""Closing the jaws of a gripper on an object: contacts, and the patches that are touched."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from grasp3d._kernels.jaws.closing import INSIDE, ClosedOn, close_on
from grasp3d._kernels.jaws.jaws import ROUNDING, Jaw
from grasp3d.arrays import ArrayLike, Floats
from grasp3d.errors import SettingError
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.closed_jaws import ClosedJaws, closed_jaws
from grasp3d.hand.jaws import IN_METRES, Corners, Jaws
from grasp3d.hand.pose_checks import checked_poses
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import check_choice
from grasp3d.settings.units import GivenLength
from grasp3d.system.context import report_progress, thread_count, unreported

FOOTPRINT = 1.0 / 3.0
"""Depth, relative to a pad's smaller side, to which the surface opposite it makes the normal.

A turn by the angle of friction of 0.5 brings onto the pad what was deeper by 1/4 to 1/2 of its
side: the first where the contact is in the pad's middle, the second where it is at its edge.
"""

NO_EDGE = (0.0, 0.0, 1.0)
"""Fills the rows of faces with fewer sides."""


def jaw_of(gripper: Jaws, scale: float) -> Jaw:
    """Shape of the jaws of a gripper.

    Args:
        gripper: The gripper.
        scale: Object sizes in one metre.
    """
    faces = [np.array(face) * scale for face in inner_faces(gripper)]
    most = max(map(len, faces))
    edges = np.empty((len(faces), most, 3))
    edges[:] = NO_EDGE
    for row, face in zip(edges, faces, strict=True):
        row[: len(face)] = _edges(face)
    points = np.concatenate(faces)[:, 1:]
    return Jaw(
        planes=np.stack([_plane(face) for face in faces]),
        edges=edges,
        bounds=np.concatenate([points.min(axis=0), points.max(axis=0)]),
        radius=gripper.tip_radius * scale,
        depth=gripper.tip_radius * scale or float(-min(face[:, 0].min() for face in faces)),
        thickness=(gripper.tip_thickness or gripper.finger_thickness) * scale,
        compliance=gripper.compliance * scale,
        footprint=FOOTPRINT * min(gripper.pad_width, gripper.pad_height) * scale,
    )


def inner_faces(gripper: Jaws) -> tuple[Corners, ...]:
    """The faces with which finger 1 touches: those stated, or the pad's rectangle [m].

    Of a round tip it is the square around it, seen along x.
    """
    if gripper.inner_faces:
        return gripper.inner_faces
    tip = gripper.tip_radius
    y, z = (tip, tip) if tip else (0.5 * gripper.pad_width, 0.5 * gripper.pad_height)
    return (((0.0, -y, -z), (0.0, y, -z), (0.0, y, z), (0.0, -y, z)),)


def _plane(face: Floats) -> Floats:
    """Coefficients of x = a + b y + c z through the corners of a face (n, 3), by least squares."""
    columns = np.column_stack([np.ones(len(face)), face[:, 1:]])
    return np.asarray(np.linalg.lstsq(columns, face[:, 0])[0])


def _edges(face: Floats) -> Floats:
    """Sides of a convex face (n, 3), seen along x: outward unit normals and positions (n, 3)."""
    points = face[:, 1:]
    along = np.roll(points, -1, axis=0) - points
    x, y = points.T
    counterclockwise = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) > 0.0
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) * (1.0 if counterclockwise else -1.0)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    # What only grazes a side is not touched.
    return np.column_stack([outward, (outward * points).sum(axis=1) - ROUNDING])


FIXED = -1.0
"""Friction with which the kernels keep the object where it is."""

CHUNK = 64
"""Most poses that one thread computes at a time."""


def close_jaws(
    mesh: ObjectMesh,
    poses: ArrayLike,
    hand: Jaws,
    *,
    opening: ArrayLike | GivenLength | None = None,
    object_motion: ObjectMotion = "fixed",
    friction: float = 0.5,
    give_way: float = 0.0,
) -> ClosedJaws:
    """Close the jaws of a gripper on an object.

    Each jaw is moved along the closing axis until it touches. Flat pads are rectangles, or the
    `inner_faces` of the gripper; of the faces that face a pad, the parts within it count, exactly.
    Round tips are balls. What a jaw touches is the surface within the gripper's compliance beyond
    the first touch: the patch. The contact is the patch's centroid, its normal the mean of the
    interpolated normals there.

    A free object gives way before that: squeezed by the jaws it turns about y and z and shifts
    along them until friction holds it, without friction until no small motion closes the jaws at a
    finite rate: one that is held exactly by its longest axis stays. The motion is quasi-static,
    without inertia and weight. In equilibrium the forces of both jaws are on one
    line, so that the contacts are the centres of pressure (`centres_of_pressure`). Normals are then
    means over what is opposite the pad within a third of its smaller side: that slope decides where
    the object goes when it rolls or slips a little.

    On a flat pad both are weighted by the area on the pad: each part of it presses along the
    closing axis by about the same amount, whatever slope is below it, so steep faces bear little
    and those parallel to the axis nothing. On a round tip they are weighted by the surface's area.

    Args:
        mesh: The object, whose unit is known.
        poses: Matrices that take coordinates of the gripper's frame to the mesh's, translations in
            metres, shape (k, 4, 4), or (4, 4) for one.
        hand: The gripper.
        opening: Opening at the start, in metres or with a unit, one or (k,); None: the stroke.
        object_motion: free: the object gives way; fixed: it does not move.
        friction: Coulomb coefficient between the jaws and a free object; at least 0.
        give_way: Where a finger starts in the object, how far it may be shifted along the closing
            axis until none does [m]; see `ClosedJaws.shift`.

    Raises:
        SettingError: The unit of the mesh is not known, or a setting is outside its range.
        ContactError: Poses that are no rigid motions; see `checked_poses`.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.hand.closed_jaws import Closing
        >>> from grasp3d.hand.closing import close_jaws
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
    free_object = object_motion == "free"
    if not 0.0 <= friction < math.inf:
        raise SettingError(f"friction must be a finite number of at least 0; got {friction:g}")
    mesh.needs_metres(IN_METRES)
    scale = 1.0 / mesh.size
    matrices = _normalized(mesh, poses)
    start = _openings(mesh, opening, hand, len(matrices))
    jaw = jaw_of(hand, scale)
    coefficient = friction if free_object else FIXED
    surface, tree = mesh.contact_surface, mesh.face_tree

    def closed_from(poses: Floats, starts: Floats) -> ClosedOn:
        count, result = len(poses), _empty(len(poses))
        step = max(1, min(CHUNK, count // (2 * thread_count())))
        firsts = range(0, count, step)

        def work(first: int) -> None:
            last = min(first + step, count)
            close_on(surface, tree, poses, starts, coefficient, jaw, first, last, result)

        with ThreadPoolExecutor(thread_count()) as executor:
            for done, _ in enumerate(executor.map(work, firsts), start=1):
                report_progress(done / len(firsts))
        return result

    result, shift = closed_from(matrices, start), np.zeros(len(matrices))
    for move in ways(give_way / mesh.size) if give_way else ():
        rows = np.flatnonzero((result.outcome == INSIDE).any(axis=1))
        if not len(rows):
            break
        moved = matrices[rows]
        moved[:, :, 3] += move * moved[:, :, 0]
        with unreported():
            again = closed_from(moved, start[rows])
        free = ~(again.outcome == INSIDE).any(axis=1)
        for values, others in zip(result, again, strict=True):
            values[rows[free]] = others[free]
        shift[rows[free]] = move * mesh.size
    return closed_jaws(
        mesh, result, matrices, jaw, least=hand.min_opening * scale, free=free_object, shift=shift
    )


WAYS = 4
"""Shifts in either direction by which an object may give way."""


def ways(most: float) -> list[float]:
    """Shifts along the closing axis by which an object may give way, the smallest first.

    Args:
        most: The largest one.
    """
    steps = np.linspace(0.0, most, WAYS + 1)[1:].tolist()
    return [sign * step for step in steps for sign in (1.0, -1.0)]


def _normalized(mesh: ObjectMesh, poses: ArrayLike) -> Floats:
    """Poses to the normalised frame as rotation and translation, shape (k, 3, 4)."""
    matrices = checked_poses(poses)
    matrices[:, :3, 3] = (matrices[:, :3, 3] - mesh.center) / mesh.size
    return np.ascontiguousarray(matrices[:, :3])


def _openings(
    mesh: ObjectMesh, opening: ArrayLike | GivenLength | None, hand: Jaws, count: int
) -> Floats:
    """Openings at the start [object sizes], shape (k,)."""
    stroke = hand.max_opening
    if isinstance(opening, str):
        opening = mesh.length("opening", opening)
    try:
        lengths = np.asarray(stroke if opening is None else opening, dtype=np.float64)
        start = np.array(np.broadcast_to(lengths, (count,)))
    except (TypeError, ValueError) as error:
        raise SettingError(
            f"opening must be one length or one for each of the {count} poses; got {opening!r}"
        ) from error
    # Openings of files are rounded.
    bad = np.flatnonzero(~((start >= 0.0) & (start <= stroke * (1.0 + 1e-6))))
    if len(bad):
        raise SettingError(
            f"pose {bad[0] + 1}: opening must be from 0 to the stroke of gripper "
            f"{hand.name!r}, {stroke:.4g} m; got {start[bad[0]]:.4g}"
        )
    return np.asarray(start / mesh.size)


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
