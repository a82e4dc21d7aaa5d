"""Closing the jaws of a gripper on an object: contacts, and the patches that are touched."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np

from grasp3d._kernels.closing import INSIDE, TOUCHES, ClosedOn, close_on
from grasp3d._kernels.face_tree import face_tree
from grasp3d._kernels.pad_contact import ROUNDING, Jaw
from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.errors import ContactError, SettingError
from grasp3d.gripper.parallel_gripper import ParallelGripper
from grasp3d.gripper.reaching import metres_per_unit
from grasp3d.lengths import length_in_unit
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import check_choice
from grasp3d.system.processors import available_processors
from grasp3d.system.progress import Progress, ignore

Moving = Literal["both", "one"]
"""Which jaws move: each until it touches, or finger 2 toward finger 1, which stays."""

CHUNK = 256
"""Poses that one thread computes at a time."""


class Closing(IntEnum):
    """What happens when the jaws close."""

    CLOSED = 0
    """Both jaws touch the object."""
    NOTHING = 1
    """The jaws reach their smallest opening before both touch, or neither touches at all."""
    ONE_SIDE = 2
    """Only one jaw touches."""
    STARTS_INSIDE = 3
    """A finger is in the object, or overlaps with it, before the jaws move."""


MEANING: dict[Closing, str] = {
    Closing.CLOSED: "both jaws touch the object",
    Closing.NOTHING: "the jaws close on nothing",
    Closing.ONE_SIDE: "only one jaw touches the object",
    Closing.STARTS_INSIDE: "a finger starts in the object",
}
"""Each state in words, as shown to users."""


@dataclass(frozen=True, eq=False)
class ClosedJaws:
    """Where the jaws of a gripper touch an object, a row for each pose and a column for each jaw.

    A jaw that touches nothing has nan, and an area of 0.
    """

    state: Bytes
    """`Closing` codes, shape (k,)."""
    points: Floats
    """Contacts: centroids of the touched patches, in the mesh's frame and unit, shape (k, 2, 3)."""
    normals: Floats
    """Unit normals into the object, means over the patches, shape (k, 2, 3)."""
    opening: Floats
    """Distance of the pads, or of the nearest points of round tips, when both touch first
    [mesh unit], shape (k,); nan unless CLOSED."""
    positions: Floats
    """Where the jaws stop: x of the pads, or of the foremost points of round tips, in the gripper's
    frame [mesh unit], shape (k, 2)."""
    area: Floats
    """Areas of the touched patches [mesh unit squared], shape (k, 2)."""
    extents: Floats
    """Sizes of the touched patches along y and z of the gripper [mesh unit], shape (k, 2, 2)."""

    __repr__ = short_repr

    @property
    def closed(self) -> Bools:
        """Whether both jaws touch the object, shape (k,)."""
        return locked(self.state == Closing.CLOSED)

    @property
    def offset(self) -> Floats:
        """How far the middle between the jaws is from the TCP, along x [mesh unit], shape (k,).

        A rigid hand whose jaws move symmetrically pushes the object by as much, against x.
        """
        return locked(self.positions.mean(axis=1))


def close_jaws(
    mesh: ObjectMesh,
    poses: ArrayLike,
    gripper: ParallelGripper,
    *,
    opening: ArrayLike | str | None = None,
    moving: Moving = "both",
    threads: int | None = None,
    progress: Progress | None = None,
) -> ClosedJaws:
    """Close the jaws of a gripper on an object that does not move.

    Each jaw is moved along the closing axis until it touches. Flat pads are rectangles; of the
    faces that face a pad, the parts within the rectangle count, exactly. Round tips are balls. What
    a jaw touches is the surface within the gripper's compliance beyond the first touch: the patch.
    The contact is the patch's centroid, its normal the mean of the interpolated normals there.

    On a flat pad both are weighted by the area on the pad: each part of it presses along the
    closing axis by about the same amount, whatever slope is below it, so steep faces bear little
    and those parallel to the axis nothing. On a round tip they are weighted by the surface's area.

    Args:
        mesh: The object, whose unit is known.
        poses: Matrices that take coordinates of the gripper's frame to the mesh's, translations in
            the mesh's unit, shape (k, 4, 4), or (4, 4) for one.
        gripper: The gripper.
        opening: Opening at the start, in the mesh's unit or with a unit, one or (k,); None: the
            stroke.
        moving: both: each jaw moves until it touches, as the hand or the object gives way; one:
            finger 2 moves, finger 1 stays at the start, where it touches only what is there.
        threads: Threads to use; None: one per processor. The result does not depend on it.
        progress: Called with the fraction of the work done, from 0 to 1.

    Raises:
        SettingError: The unit of the mesh is not known, or a setting is outside its range.
        ContactError: Poses of another shape, or values that are not finite.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.gripper.closing import Closing, close_jaws
        >>> from grasp3d.gripper.parallel_gripper import ParallelGripper
        >>> gripper = ParallelGripper(
        ...     name="small", max_opening=0.08, pad_width=0.02, pad_height=0.01,
        ...     finger_thickness=0.01, finger_width=0.02, finger_length=0.05,
        ...     palm_thickness=0.1, palm_width=0.05, palm_length=0.05,
        ... )
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.05, 0.03]), unit="m")
        >>> found = close_jaws(box, np.eye(4), gripper)
        >>> Closing(found.state[0]).name, found.opening.round(6).tolist()
        ('CLOSED', [0.06])
        >>> found.normals[0, :, 0].round(6).tolist(), (1e6 * found.area).round(3).tolist()
        ([1.0, -1.0], [[200.0, 200.0]])
    """
    check_choice("moving", moving, Moving)
    scale = 1.0 / (metres_per_unit(mesh) * mesh.size)  # from metres
    matrices = _normalized(mesh, poses)
    start = _openings(mesh, opening, gripper, len(matrices))
    jaw = _jaw(gripper, scale)
    found = _empty(len(matrices))
    _run(mesh, matrices, start, jaw, found, threads, progress or ignore)
    return _results(mesh, found, start, gripper.min_opening * scale, jaw, moving)


def _normalized(mesh: ObjectMesh, poses: ArrayLike) -> Floats:
    """Poses to the normalised frame as rotation and translation, shape (k, 3, 4)."""
    try:
        matrices = np.array(poses, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ContactError(f"poses must be 4x4 matrices of numbers: {error}") from error
    if matrices.ndim == 2:
        matrices = matrices[None]
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4):
        raise ContactError(f"poses must be 4x4 matrices, shape (k, 4, 4); got {np.shape(poses)}")
    bad = np.flatnonzero(~np.isfinite(matrices).all(axis=(1, 2)))
    if len(bad):
        raise ContactError(f"pose {bad[0] + 1} has numbers that are not finite")
    matrices[:, :3, 3] = (matrices[:, :3, 3] - mesh.center) / mesh.size
    return np.ascontiguousarray(matrices[:, :3])


def _openings(
    mesh: ObjectMesh, opening: ArrayLike | str | None, gripper: ParallelGripper, count: int
) -> Floats:
    """Openings at the start [object sizes], shape (k,)."""
    stroke = gripper.max_opening / metres_per_unit(mesh)
    if isinstance(opening, str):
        opening = length_in_unit("opening", opening, mesh.unit)
    try:
        given = np.asarray(stroke if opening is None else opening, dtype=np.float64)
        start = np.array(np.broadcast_to(given, (count,)))
    except (TypeError, ValueError) as error:
        raise SettingError(
            f"opening must be one length or one for each of the {count} poses; got {opening!r}"
        ) from error
    # Openings of files are rounded.
    bad = np.flatnonzero(~((start >= 0.0) & (start <= stroke * (1.0 + 1e-6))))
    if len(bad):
        raise SettingError(
            f"pose {bad[0] + 1}: opening must be from 0 to the stroke of gripper "
            f"{gripper.name!r}, {stroke:.4g} {mesh.unit}; got {start[bad[0]]:.4g}"
        )
    return np.asarray(start / mesh.size)


def _jaw(gripper: ParallelGripper, scale: float) -> Jaw:
    """Shape of a jaw in object sizes, of which one metre is `scale`."""
    tip = gripper.tip_radius
    width, height = (2.0 * tip, 2.0 * tip) if tip else (gripper.pad_width, gripper.pad_height)
    return Jaw(
        0.5 * width * scale,
        0.5 * height * scale,
        tip * scale,
        gripper.finger_thickness * scale,
        gripper.compliance * scale,
    )


def _empty(count: int) -> ClosedOn:
    return ClosedOn(
        outcome=np.zeros((count, 2), dtype=np.int64),
        position=np.full((count, 2), math.nan),
        points=np.full((count, 2, 3), math.nan),
        normals=np.full((count, 2, 3), math.nan),
        area=np.zeros((count, 2)),
        extents=np.zeros((count, 2, 2)),
    )


def _run(
    mesh: ObjectMesh,
    matrices: Floats,
    start: Floats,
    jaw: Jaw,
    found: ClosedOn,
    threads: int | None,
    progress: Progress,
) -> None:
    """Close the jaws from every pose, in chunks; `found` is written."""
    threads = available_processors() if threads is None else threads
    if threads < 1:
        raise SettingError(f"threads must be at least 1; got {threads}")
    surface = mesh.contact_surface
    tree = face_tree(surface)
    firsts = range(0, len(matrices), CHUNK)

    def work(first: int) -> None:
        last = min(first + CHUNK, len(matrices))
        close_on(surface, tree, matrices, start, jaw, first, last, found)

    with ThreadPoolExecutor(threads) as executor:
        for done, _ in enumerate(executor.map(work, firsts), start=1):
            progress(done / len(firsts))


def _results(
    mesh: ObjectMesh, found: ClosedOn, start: Floats, least: float, jaw: Jaw, moving: Moving
) -> ClosedJaws:
    """States, and everything in the mesh's frame and unit."""
    touches = found.outcome == TOUCHES
    if moving == "one":  # finger 1 touches what it has before it moves
        ahead = found.position[:, 0] + 0.5 * start > jaw.compliance + ROUNDING
        touches[:, 0] &= ~ahead
    opening = found.position[:, 1] - found.position[:, 0]
    state = _states(touches, found.outcome, opening, least)
    shown = touches & np.isin(state, (Closing.CLOSED, Closing.ONE_SIDE))[:, None]
    hidden = np.where(shown, 1.0, math.nan)
    return ClosedJaws(
        state=locked(state),
        points=locked(mesh.from_normalized(found.points) * hidden[..., None]),
        normals=locked(found.normals * hidden[..., None]),
        opening=locked(np.where(state == Closing.CLOSED, opening, math.nan) * mesh.size),
        positions=locked(found.position * hidden * mesh.size),
        area=locked(np.where(shown, found.area, 0.0) * mesh.size**2),
        extents=locked(np.where(shown[..., None], found.extents, 0.0) * mesh.size),
    )


def _states(touches: Bools, outcome: Ints, opening: Floats, least: float) -> Bytes:
    """`Closing` codes, shape (k,)."""
    state = np.full(len(touches), Closing.NOTHING, dtype=np.uint8)
    both = touches.all(axis=1)
    state[touches.any(axis=1) & ~both] = Closing.ONE_SIDE
    state[both & (opening >= least - ROUNDING)] = Closing.CLOSED
    state[(outcome == INSIDE).any(axis=1)] = Closing.STARTS_INSIDE
    return state
