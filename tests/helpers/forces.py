"""Grasps under load, and checks of the proofs of their grip forces."""

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import Contacts
from grasp3d.quality import GripForce, Task

Floats = NDArray[np.float64]

GRAVITY = 9.80665


def opposed(width: float = 0.04, *, friction: float = 0.5, torsion: float = 0.004) -> Contacts:
    """Two fingers that push toward each other along x, about the centre of mass."""
    points = [[-width / 2, 0.0, 0.0], [width / 2, 0.0, 0.0]]
    return Contacts(points, [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], friction, torsion)


def moved(contacts: Contacts, offset: Floats | list[float]) -> Contacts:
    """The same contacts about another centre of mass."""
    points = contacts.points - np.asarray(offset)
    return Contacts(points, contacts.normals, contacts.friction, contacts.torsion_radius)


def wrench_of(contacts: Contacts, forces: Floats) -> Floats:
    """Wrenches of contact forces with torsional moments (..., n, 4), shape (..., 6)."""
    moments = np.cross(contacts.points, forces[..., :3]) + forces[..., 3:] * contacts.normals
    return np.concatenate([forces[..., :3].sum(axis=-2), moments.sum(axis=-2)], axis=-1)


def check_proof(
    contacts: Contacts,
    found: GripForce,
    task: Task | None = None,
    *,
    bound: str = "normal",
    rtol: float = 1e-8,
) -> None:
    """Check that contact forces balance the wrench within the bound, and that no less suffices.

    The forces for the hardest wrench of a task may exceed the bound by `rtol`.
    """
    finite = np.isfinite(found.upper)
    proof, upper = found.certificate, np.where(finite, found.upper, 1.0)
    size = np.maximum(np.abs(proof.forces[..., :3]).sum(axis=(-1, -2)), 1e-300)
    reach = np.linalg.norm(contacts.points, axis=-1).max(axis=-1) + 1e-300
    missing = wrench_of(contacts, proof.forces) + proof.wrench
    missing[..., 3:] /= reach[..., None]
    assert (np.abs(missing).max(axis=-1) <= 1e-8 * size)[finite].all(), "forces do not balance"
    normal = (proof.forces[..., :3] * contacts.normals).sum(axis=-1)
    sideways = np.linalg.norm(proof.forces[..., :3] - normal[..., None] * contacts.normals, axis=-1)
    friction, radius = contacts.friction, contacts.torsion_radius
    with np.errstate(divide="ignore", invalid="ignore"):
        twist = np.where(radius > 0.0, proof.forces[..., 3] / radius, 0.0)
        used = np.hypot(np.where(sideways > 0.0, sideways / friction, 0.0), twist)
    slack = 1e-8 * size[..., None]
    assert (used <= normal + slack)[finite].all(), "a force is outside its limit surface"
    bounded = {
        "normal": fingers(contacts, normal, np.add).max(axis=-1),
        "norm": fingers(contacts, np.linalg.norm(proof.forces[..., :3], axis=-1), np.add).max(
            axis=-1
        ),
        "total": normal.sum(axis=-1),
    }[bound]
    assert (bounded <= upper * (1.0 + rtol))[finite].all(), "a force exceeds the bound"
    support = support_of(contacts, proof.direction, bound)
    needed = -(proof.wrench * proof.direction).sum(axis=-1)
    if task is not None:
        assert needed == pytest.approx(task.support(-proof.direction), rel=1e-9)
    lower = np.where(finite, found.lower, 0.0)
    assert (lower * support <= needed * (1.0 + rtol) + 1e-12)[finite].all(), "not proven"
    assert (found.lower <= found.upper).all()
    # Where no force suffices, the direction separates the wrench from the forces.
    finite = finite | np.isfinite(found.lower)
    scale = np.abs(proof.direction).max(axis=-1) * np.maximum(reach, 1.0)
    assert (support <= 1e-9 * scale)[~finite].all()
    assert (needed > 0.0)[~finite].all()


def support_of(contacts: Contacts, directions: Floats, bound: str) -> Floats:
    """Reach of contact forces bounded by 1 along directions (..., 6), by fine sampling."""
    g = directions[..., None, :3] + np.cross(directions[..., None, 3:], contacts.points)
    along = (g * contacts.normals).sum(axis=-1)
    across = np.linalg.norm(g - along[..., None] * contacts.normals, axis=-1)
    twist = (directions[..., None, 3:] * contacts.normals).sum(axis=-1) * contacts.torsion_radius
    if bound == "norm":
        angles = np.linspace(0.0, np.pi / 2.0, 20001)
        sines, friction = np.sin(angles), contacts.friction[..., None]
        heights = along[..., None] + friction * sines * across[..., None]
        heights += np.cos(angles) * np.abs(twist)[..., None]
        values = (heights / np.hypot(1.0, friction * sines)).max(axis=-1)
    else:
        values = along + np.hypot(contacts.friction * across, twist)
    values = np.maximum(values, 0.0)
    if bound == "total":
        return np.asarray(values.max(axis=-1))
    return np.asarray(fingers(contacts, values, np.maximum).sum(axis=-1))


def fingers(contacts: Contacts, values: Floats, combine: np.ufunc) -> Floats:
    """Combine values at contacts (..., n), all at least 0, over the contacts of each finger."""
    groups = np.arange(contacts.count) if contacts.groups is None else contacts.groups
    result = np.zeros((groups.max() + 1, *values.shape[:-1]))
    combine.at(result, groups, np.moveaxis(values, -1, 0))
    return np.moveaxis(result, 0, -1)
