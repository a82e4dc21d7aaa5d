"""Grasps with patches, and slow ways to evaluate them."""

import math

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grasp3d import Contacts
from grasp3d.contact.contacts import in_tangent_plane
from grasp3d.contact.friction_cones import cone_edges

Floats = NDArray[np.float64]


def random_patches(
    count: int, fingers: int, seed: int, *, torsion: float = 0.0, size: float = 0.3
) -> Contacts:
    """Grasps about a ball, normals roughly inward, with elliptic patches of any direction."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, fingers, 3))
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    if fingers == 2:
        points[:, 1] = -points[:, 0] + 0.4 * rng.normal(size=(count, 3))
    normals = -points + 0.3 * rng.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    patch = in_tangent_plane(size * rng.normal(size=(*points.shape[:-1], 2, 3)), normals)
    return Contacts(points, normals, rng.uniform(0.4, 0.9, points.shape[:-1]), torsion, patch)


def rotated(contacts: Contacts, rotation: Floats) -> Contacts:
    """The same grasps in another frame."""
    patch = None if contacts.patch is None else contacts.patch @ rotation.T
    return Contacts(
        contacts.points @ rotation.T, contacts.normals @ rotation.T, contacts.friction,
        contacts.torsion_radius, patch,
    )  # fmt: skip


def scaled(contacts: Contacts, unit: float) -> Contacts:
    """The same grasps in another unit of length."""
    patch = None if contacts.patch is None else unit * contacts.patch
    return Contacts(
        unit * contacts.points, contacts.normals, contacts.friction,
        unit * contacts.torsion_radius, patch,
    )  # fmt: skip


def shifted(contacts: Contacts, shift: Floats) -> Contacts:
    """The same grasps about another centre of mass."""
    return Contacts(
        contacts.points + shift, contacts.normals, contacts.friction, contacts.torsion_radius,
        contacts.patch,
    )  # fmt: skip


def reordered(contacts: Contacts, order: Floats) -> Contacts:
    """One grasp with its contacts in another order."""
    patch = None if contacts.patch is None else contacts.patch[order]
    return Contacts(
        contacts.points[order], contacts.normals[order], contacts.friction[order],
        contacts.torsion_radius[order], patch,
    )  # fmt: skip


def stacked(single: list[Contacts]) -> Contacts:
    """A batch of single grasps, all with patches or none."""
    names = ("points", "normals", "friction", "torsion_radius", "patch")
    columns = ([getattr(one, name) for one in single] for name in names)
    return Contacts(*(None if column[0] is None else np.stack(column) for column in columns))


def resized(contacts: Contacts, factor: float) -> Contacts:
    """The same grasps with larger or smaller patches."""
    assert contacts.patch is not None
    return Contacts(
        contacts.points, contacts.normals, contacts.friction, contacts.torsion_radius,
        factor * contacts.patch,
    )  # fmt: skip


def tilted_wrenches(
    contacts: Contacts, normals: Floats, *, edges: int = 24, corners: int = 24
) -> Floats:
    """Wrenches of cones about other normals, of one grasp, the patches staying where they are.

    Each edge of each cone, with the pressure at each of the corners of the patch: its moment is the
    component of the force along the perceived normal times lever x normal. Shape (k, 6).
    """
    assert contacts.patch is not None
    forces = cone_edges(normals, contacts.friction_angle, edges=edges)  # (n, m, 3)
    angles = 2.0 * math.pi * np.arange(corners) / corners
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ contacts.patch  # (n, k, 3)
    levers = np.cross(rim, contacts.normals[:, None])
    pressing = (forces * contacts.normals[:, None]).sum(axis=-1)
    moments = np.cross(contacts.points[:, None], forces)[:, :, None]
    moments = moments + pressing[:, :, None, None] * levers[:, None]
    forces = np.broadcast_to(forces[:, :, None], moments.shape)
    return np.concatenate([forces, moments], axis=-1).reshape(-1, 6)


def _solve(
    goal: Floats, rows: list[Floats], constants: list[float], cones: list[object]
) -> tuple[float, Floats]:
    """Smallest goal . x with constants - rows x in the cones, and x."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    found = clarabel.DefaultSolver(
        sparse.csc_matrix((len(goal), len(goal))), goal, sparse.csc_matrix(np.array(rows)),
        np.array(constants), cones, settings,
    ).solve()  # fmt: skip
    solved = found.status in {clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved}
    return (float(found.obj_val) if solved else math.inf), np.array(found.x)


def best_line(points: Floats, first: Floats, second: Floats, patch: Floats) -> tuple[float, Floats]:
    """Least of the larger angle between a line from patch to patch and two directions.

    A second-order cone program over the line's length and the centres of pressure; inf where no
    line is within 90 degrees of both.
    """
    line = np.concatenate([-patch[0], patch[1], [points[1] - points[0]], np.zeros((1, 3))]).T
    unit = np.eye(6)
    rows = [unit[5] - first @ line, unit[5] - second @ line, np.zeros(6), *-line]
    for k in (0, 2):
        rows += [-unit[4], -unit[k], -unit[k + 1]]
    cones = [clarabel.NonnegativeConeT(2), clarabel.SecondOrderConeT(4)]
    cones += [clarabel.SecondOrderConeT(3)] * 2
    value, x = _solve(-unit[5], rows, [0.0, 0.0, 1.0, *[0.0] * 9], cones)
    cosine = -value
    return (math.inf if cosine < 1e-6 else math.acos(min(cosine, 1.0))), line @ x


def force_by_program(contacts: Contacts, wrench: Floats, bound: str = "normal") -> float:
    """Least force per patch that resists a wrench, by hard contacts at eight points of its rim.

    The normal components at the points of a patch, or the lengths, together are bounded.
    """
    assert contacts.patch is not None
    angles = 0.25 * math.pi * np.arange(8)
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ contacts.patch  # (n, 8, 3)
    points = contacts.points[:, None] + rim
    return force_of_points(points, contacts.normals, contacts.friction, wrench, bound)


def force_of_points(
    points: Floats, normals: Floats, friction: Floats, wrench: Floats, bound: str = "normal"
) -> float:
    """The same of hard contacts at points (n, k, 3) of n patches with normals (n, 3)."""
    patches, size = points.shape[:2]
    count = size * patches
    columns = 4 * count + 1  # each point's force and share of the bound; then the bound
    balance, below = np.zeros((6, columns)), np.zeros((patches, columns))
    rows, cones = [], [clarabel.ZeroConeT(6)]
    for k in range(count):
        i = k // size
        point, normal = points[i, k % size], normals[i]
        balance[:3, 4 * k : 4 * k + 3] = np.eye(3)
        balance[3:, 4 * k : 4 * k + 3] = np.cross(point, np.eye(3)).T
        local = np.eye(columns)[4 * k : 4 * k + 4]
        pressing = normal @ local[:3]
        sideways = (np.eye(3) - np.outer(normal, normal)) @ local[:3]
        rows += [-friction[i] * pressing, *-sideways]
        cones.append(clarabel.SecondOrderConeT(4))
        rows += [-local[3], *-(local[:3] if bound == "norm" else np.outer(normal, pressing))]
        cones.append(clarabel.SecondOrderConeT(4))
        below[i] += local[3]
    below[:, -1] = -1.0
    cones.append(clarabel.NonnegativeConeT(patches))
    constants = [*-wrench, *[0.0] * (len(rows) + patches)]
    return _solve(np.eye(columns)[-1], [*balance, *rows, *below], constants, cones)[0]
