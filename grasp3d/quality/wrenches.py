"""Wrenches of contacts, their span, and the options of their hulls.

A wrench is (f, (p x f) / rho): force and torque about the centre of mass, the torque divided by the
torque scale rho, so that both are weighted alike and nothing depends on the mesh's unit.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from grasp3d._kernels.hull.wrenches import span as span_kernel
from grasp3d._kernels.hull.wrenches import write_axes
from grasp3d.arrays import ArrayLike, Floats
from grasp3d.contact.contacts import NEAR_X_AXIS, Contacts, edge_angles
from grasp3d.errors import ContactError, SettingError
from grasp3d.settings import check_choice

Actuation = Literal["total", "per_finger"]
"""Which forces are limited together: those of all fingers, or those of each."""

Bounded = Literal["force", "normal"]
"""Which size of a contact force is limited: its length, or its normal component."""

MAX_FRICTION = 1e6
"""Friction from which unit normal components are lost to rounding among the tangential ones."""

Goal = tuple[float, float, float]
"""When a hull need not be grown further: relative tolerance of the bounds; absolute tolerance and
cutoff, relative to the largest wrench; see `_kernels.hull.growing_hull.grow`."""

UNDECIDED_WITHIN = 1e-8
"""Width, relative to the largest wrench, of an interval about 0 that is left undecided."""


def check_torque_scale(torque_scale: float) -> None:
    """Raise SettingError unless the torque scale is a length."""
    if not (torque_scale > 0.0 and math.isfinite(torque_scale)):
        raise SettingError(f"torque_scale must be a finite length above 0; got {torque_scale}")


def check_rtol(rtol: float) -> None:
    """Raise SettingError unless a relative tolerance lies between 0 and 1."""
    if not 0.0 < rtol < 1.0:
        raise SettingError(f"rtol must lie between 0 and 1; got {rtol}")


def wrench_axes(
    points: Floats, normals: Floats, torsion_radius: Floats, torque_scale: float
) -> Floats:
    """Wrenches of unit forces along each contact's normal and tangents, and of its moment.

    Every wrench of a contact is a linear combination of its axes. The tangents are those of
    `contacts.tangents`; the fourth axis is the torsional moment that a unit normal force allows.

    Args:
        points: Relative to the centre of mass [m], shape (..., 3).
        normals: Inward unit normals, shape (..., 3).
        torsion_radius: [m], shape (...).
        torque_scale: rho [m].

    Returns:
        Shape (..., 4, 6).
    """
    axes = np.zeros((*points.shape[:-1], 4, 6))
    write_axes(
        read_only(points, (-1, 3)),
        read_only(normals, (-1, 3)),
        read_only(torsion_radius, (-1,)),
        float(torque_scale),
        NEAR_X_AXIS,
        axes.reshape(-1, 4, 6),
    )
    return axes


def read_only(values: Floats, shape: tuple[int, ...]) -> Floats:
    """Read-only view of contiguous values, so that a kernel is compiled for one kind only."""
    view = np.ascontiguousarray(values, dtype=np.float64).reshape(shape)
    view.flags.writeable = False
    return view


def cone_parts(friction_angle: Floats, bounded: Bounded = "force") -> Floats:
    """Normal and tangential component of a force on the rim of a friction cone.

    Args:
        friction_angle: Half-angles [rad], shape (...).
        bounded: 'force': the force has length 1; 'normal': its normal component is 1.

    Returns:
        Shape (..., 2).

    Raises:
        SettingError: An unknown `bounded`, or a cone too wide for a unit normal component.
    """
    check_choice("bound", bounded, Bounded)
    parts = np.ones((*friction_angle.shape, 2))
    if bounded == "force":
        np.cos(friction_angle, out=parts[..., 0])
        np.sin(friction_angle, out=parts[..., 1])
        return parts
    if not (friction_angle < math.pi / 2.0).all():
        raise SettingError("with unit normal components friction cones must stay below 90 degrees")
    if not (friction_angle < math.atan(MAX_FRICTION)).all():
        raise SettingError(f"with unit normal components friction must stay below {MAX_FRICTION:g}")
    np.tan(friction_angle, out=parts[..., 1])
    return parts


def wrenches(
    contacts: Contacts,
    *,
    edges: int = 8,
    torque_scale: float = 1.0,
    phase: float = 0.0,
    bounded: Bounded = "force",
) -> Floats:
    """Primitive wrenches of polygonal friction cones (Wan & Howe 2018, Sec. II).

    Args:
        contacts: The contacts.
        edges: Number of edges of each cone, at least 3.
        torque_scale: rho [m].
        phase: Angle of the first edge about the normal, from the first of `contacts.tangents`
            [rad].
        bounded: 'force': edges of length 1; 'normal': of normal component 1, as in some
            packages.

    Returns:
        Rows (..., n * m, 6), contact by contact: m = `edges`, or two more if any finger is soft:
        the normal force with its torsional moment in either sense (for hard fingers the first edge,
        twice). Their hull is a double pyramid, inscribed in the elliptic limit surface of circular
        cones.

    Raises:
        SettingError: A setting outside its range.
    """
    check_torque_scale(torque_scale)
    parts = cone_parts(contacts.friction_angle, bounded)
    forces = edge_forces(parts, contacts.torsion_radius, edges, phase)  # (..., n, m, 4)
    axes = wrench_axes(
        contacts.points, contacts.normals, contacts.torsion_radius, torque_scale
    )  # (..., n, 4, 6)
    return (forces @ axes).reshape(*contacts.batch, -1, 6)


def edge_forces(parts: Floats, torsion_radius: Floats, edges: int, phase: float) -> Floats:
    """Forces along the edges of polygonal friction cones, as components along the contacts' axes.

    Args:
        parts: Normal and tangential components, as from `cone_parts`, shape (..., n, 2).
        torsion_radius: [m], shape (..., n).
        edges: Number of edges of each cone, at least 3.
        phase: As in `wrenches`.

    Returns:
        Shape (..., n, m, 4); see `wrenches` on m.

    Raises:
        SettingError: Too few edges, or too many.
    """
    angles = edge_angles(edges, phase)
    soft = bool((torsion_radius > 0.0).any())
    forces = np.zeros((*torsion_radius.shape, edges + 2 * soft, 4))
    forces[..., :edges, 0] = parts[..., :1]
    forces[..., :edges, 1] = parts[..., 1:] * np.cos(angles)
    forces[..., :edges, 2] = parts[..., 1:] * np.sin(angles)
    if soft:
        resists = (torsion_radius > 0.0)[..., None, None]
        twists = np.array([[1.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, -1.0]])
        forces[..., edges:, :] = np.where(resists, twists, forces[..., :1, :])
    return forces


def span(rows: ArrayLike) -> Floats:
    """Orthonormal basis of the span of wrenches; its length is their rank.

    Two hard fingers, or more on one line, cannot resist a torque about that line: their wrenches
    span five dimensions. With forces and torques each divided by the largest among the rows, a
    wrench adds a dimension if more than 1e-12 of it lies outside the span of the others.

    Args:
        rows: Wrenches (k, 6).

    Returns:
        Shape (rank, 6).

    Raises:
        ContactError: Rows of another shape, or values that are not finite.
    """
    values = np.ascontiguousarray(rows, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != 6 or not np.isfinite(values).all():
        raise ContactError(f"wrenches must be finite and of shape (k, 6); got {values.shape}")
    basis = np.zeros((6, 6))
    rank = span_kernel(values, np.zeros_like(values), basis)
    return basis[:rank]


@dataclass(frozen=True)
class EpsilonOptions:
    """Cones, actuation, torque scale and accuracy of epsilon (Ferrari & Canny 1992).

    Attributes:
        edges: Edges of polygonal friction cones; None: circular cones.
        actuation: 'total': the sum of all forces is at most 1 (the hull of the contacts' wrenches);
            'per_finger': each finger's force is at most 1 (the Minkowski sum).
        torque_scale: Length that torques are divided by [m]; `ObjectMesh.torque_scale`
            makes epsilon independent of the unit.
        rtol: Circular cones: largest difference of the bounds, as a fraction of the upper one.

    Raises:
        SettingError: An option outside its range.

    Example:
        Polygonal cones of eight edges, with each finger's force limited:

        >>> import grasp3d
        >>> contacts = grasp3d.Contacts([[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]])
        >>> options = grasp3d.EpsilonOptions(edges=8, actuation="per_finger")
        >>> found = grasp3d.classify(contacts, 0.4, options=options)
        >>> print(f"{found.epsilon:.3f}")
        0.489
    """

    edges: int | None = None
    actuation: Actuation = "total"
    torque_scale: float = 1.0
    rtol: float = 1e-3

    def __post_init__(self) -> None:
        check_choice("actuation", self.actuation, Actuation)
        check_torque_scale(self.torque_scale)
        check_rtol(self.rtol)
        if self.edges is not None:
            edge_angles(self.edges)  # raises SettingError

    @property
    def polygonal(self) -> bool:
        """Whether cones are polygons, for which epsilon has an exact value."""
        return self.edges is not None

    @property
    def goal(self) -> Goal:
        """How close the bounds must be, as `WrenchProblem.solve` takes it."""
        tolerances = (0.0, 0.0) if self.polygonal else (self.rtol, UNDECIDED_WITHIN)
        return (*tolerances, math.inf)
