"""Checks of grasp poses: whether they are rigid motions, and near the object."""

from typing import TYPE_CHECKING

import numpy as np

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.contact.contacts import LARGEST
from grasp3d.errors import ContactError
from grasp3d.mesh.plausible_units import guess_unit, unit_warning
from grasp3d.settings.units import METRES, Unit

if TYPE_CHECKING:
    from grasp3d.mesh import ObjectMesh

TOLERANCE = 1e-3
"""Largest deviation from a rotation, for numbers rounded to few digits; more is an error."""

ROUNDING = 1e-12
"""Deviation up to which a rotation is left as it is."""

FAR = 20.0
"""Distance of a TCP from the object, in object sizes, that cannot be intended."""

BESIDE = 0.02, 1.0, 10.0
"""Median distances of TCPs, in object sizes: the range in which a unit is likely, and the largest
with which the best unit is likely if no other is."""

GIVE_UNIT = "give their unit: a column unit in their table, in Python unit=..."
"""Remedy for messages."""


NEAR = 1.0 / 200.0
"""Extent of all the TCPs, in object sizes, that suggests another unit."""


def checked_pose(value: ArrayLike, what: str) -> Floats:
    """One pose, checked as in `checked_poses`, shape (4, 4). Raises ContactError, naming `what`."""
    try:
        (pose,) = checked_poses(value)
    except (ContactError, ValueError) as error:
        text = str(error).removeprefix("pose 1").lstrip(": ")
        raise ContactError(f"{what}: {text}") from error
    return np.asarray(pose)


def checked_poses(values: ArrayLike) -> Floats:
    """Poses as finite 4x4 matrices with rotations, shape (k, 4, 4).

    Matrices within 0.001 of a rotation, such as those written with few digits, are replaced by the
    nearest rotation.

    Args:
        values: Shape (k, 4, 4), or (4, 4) for one pose.

    Raises:
        ContactError: The shape is wrong, a value is not finite, or a matrix is not a rotation.
    """
    try:
        poses = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ContactError(f"poses must be 4x4 matrices of numbers: {error}") from error
    if poses.ndim == 2:
        poses = poses[None]
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ContactError(f"poses must be 4x4 matrices, shape (k, 4, 4); got {np.shape(values)}")
    for k in np.flatnonzero(~np.isfinite(poses).all(axis=(1, 2))):
        raise ContactError(f"pose {k + 1} has numbers that are not finite")
    if np.abs(poses).max(initial=0.0) > LARGEST:
        raise ContactError(f"poses must not exceed {LARGEST:g}; got {np.abs(poses).max():g}")
    last = np.array([0.0, 0.0, 0.0, 1.0])
    for k in np.flatnonzero(np.abs(poses[:, 3] - last).max(axis=1) > TOLERANCE):
        transposed = np.abs(poses[k, :, 3] - last).max() <= TOLERANCE
        cause = "; is it transposed, with the translation in the last row?" if transposed else ""
        got = numbers_text(poses[k, 3])
        raise ContactError(f"pose {k + 1}: the last row must be 0 0 0 1; got {got}{cause}")
    poses[:, :3, :3] = _rotations(poses[:, :3, :3])
    poses[:, 3] = last
    return poses


def checked_quaternions(values: Floats, where: str = "") -> Floats:
    """Normalise quaternions that were written with few digits, shape (k, 4), in any order.

    Args:
        values: Shape (k, 4), finite.
        where: Start of the message, such as the name of a column.

    Raises:
        ContactError: A length is not 1.
    """
    lengths = np.linalg.norm(values, axis=1)
    for k in np.flatnonzero(~(np.abs(lengths - 1.0) <= TOLERANCE)):
        raise ContactError(
            f"{where}grasp {k + 1}: a quaternion must have length 1; got "
            f"{numbers_text(values[k])} of length {lengths[k]:.4g}"
        )
    return np.asarray(values / lengths[:, None])


def _rotations(matrices: Floats) -> Floats:
    """The nearest rotations (k, 3, 3). Raises ContactError if they are too far."""
    products = matrices.transpose(0, 2, 1) @ matrices
    deviation = np.abs(products - np.eye(3)).max(axis=(1, 2), initial=0.0)
    for k in np.flatnonzero(~(deviation <= 2.0 * TOLERANCE)):
        raise ContactError(f"pose {k + 1}: {_why_no_rotation(products[k])}")
    mirrored = np.flatnonzero(np.linalg.det(matrices) < 0.0)
    if len(mirrored):
        others = f", as are {len(mirrored)} of {len(matrices)}" if len(matrices) > 1 else ""
        raise ContactError(
            f"pose {mirrored[0] + 1} is left-handed (determinant -1){others}: one axis is "
            "reversed; y must be z x x"
        )
    rough = np.flatnonzero(deviation > ROUNDING)
    if len(rough):
        left, _, right = np.linalg.svd(matrices[rough])
        matrices[rough] = left @ right
    return matrices


def _why_no_rotation(product: Floats) -> str:
    """Why a matrix is not a rotation, from the products of its columns."""
    lengths = np.sqrt(np.diagonal(product))
    if not (lengths > 0.0).all():
        return "one of its axes has the length 0"
    cosines = product / np.outer(lengths, lengths)
    if np.abs(cosines - np.eye(3)).max() <= 2.0 * TOLERANCE:
        return (
            f"its axes have the lengths {numbers_text(lengths)} instead of 1: is a scale contained "
            "in the matrix? scale translations only"
        )
    return "its first three rows and columns are no rotation: the axes are not perpendicular"


def check_near(
    poses: Floats, mesh: "ObjectMesh", *, stated: Unit | None = None, reach: float = 0.0
) -> None:
    """Raise ContactError if all poses are far away from the object.

    Args:
        poses: TCP frame to the object's frame, shape (k, 4, 4).
        mesh: The object.
        stated: Unit that was stated for the poses; None: they were read in the unit of the mesh
            file.
        reach: Distance up to which no pose is far, such as the size of the hand.

    Raises:
        ContactError: All are far away; the message names a unit that would bring them near.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.hand.pose_checks import check_near
        >>> pose = np.eye(4)
        >>> pose[:3, 3] = [10.0, 20.0, 60.0]
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(1, 0.05), unit="m")
        >>> check_near(pose[None], ball)
        Traceback (most recent call last):
            ...
        grasp3d.errors.ContactError: all poses (1) are far from the object, 640 times its size: ...
    """
    size, unit, distances = mesh.size, mesh.file_unit, _distances(poses, mesh)
    if unit is None or not len(poses) or not (distances > max(FAR * size, reach)).all():
        return
    unit_of, of_mesh = stated or unit, guess_unit(mesh.file_size).unit
    other = _likely_units(poses[:, :3, 3], mesh, unit_of)
    if stated is not None and of_mesh is not None and unit_warning(mesh.file_size, unit):
        remedy = f"if the mesh is in {of_mesh}, not in {unit}, give --unit {of_mesh}"
    elif other:
        remedy = f"if their lengths are in {other}, not in {unit_of}, {GIVE_UNIT}"
    else:
        remedy = "are they in another frame? Give the pose of the object in it (--object-pose)"
    ratio = float(np.median(distances)) / size
    raise ContactError(
        f"all poses ({len(poses)}) are far from the object, {ratio:,.0f} times its size: {remedy}"
    )


def _likely_units(points: Floats, mesh: "ObjectMesh", unit: Unit) -> str:
    """Other units in which positions [m] read in `unit` would be at the object; empty: none."""
    ratios = {}
    for other in (one for one in METRES if one != unit):
        away = np.linalg.norm(points * (METRES[other] / METRES[unit]) - mesh.center, axis=1)
        ratios[other] = float(np.median(away)) / mesh.size
    near = [other for other, ratio in ratios.items() if BESIDE[0] <= ratio <= BESIDE[1]]
    nearest = min(ratios, key=lambda other: ratios[other])
    return " or ".join(near or [nearest] * (ratios[nearest] <= BESIDE[2]))


def pose_warning(poses: Floats, mesh: "ObjectMesh", *, reach: float = 0.0) -> str | None:
    """Return a warning if poses seem to be in another unit or frame than the object.

    Args:
        poses: As in `check_near`.
        mesh: The object.
        reach: As in `check_near`.

    Returns:
        One sentence; None if nothing suggests that.
    """
    points, size, unit = poses[:, :3, 3], mesh.size, mesh.file_unit
    if far := int((_distances(poses, mesh) > max(FAR * size, reach)).sum()):
        return (
            f"{far} of {len(poses)} poses are over {FAR:g} object sizes away from the object: are "
            "they in its frame, and in one unit?"
        )
    extent = float(np.linalg.norm(np.ptp(points, axis=0))) / size if len(points) > 2 else 0.0
    origin = float(np.linalg.norm(points, axis=1).max(initial=0.0)) / size
    small = 0.0 < extent < NEAR > origin
    if unit and small and (other := _likely_units(points, mesh, unit)):
        return (
            f"the positions of these poses differ by {extent:.2g} object sizes: if their "
            f"lengths are in {other}, not in {unit}, {GIVE_UNIT}"
        )
    return None


def _distances(poses: Floats, mesh: "ObjectMesh") -> Floats:
    return np.asarray(np.linalg.norm(poses[:, :3, 3] - mesh.center, axis=1))


def numbers_text(values: Floats) -> str:
    """Numbers in brackets, for messages."""
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"
