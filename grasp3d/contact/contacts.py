"""Point contacts between fingers and an object, and the edges of their friction cones."""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real

import numpy as np

from grasp3d._kernels.hull.wrenches import centre
from grasp3d.arrays import RIGHT_ANGLE, ArrayLike, Floats, Ints, locked, short_repr, unit_rows
from grasp3d.errors import ContactError, GraspError, SettingError

NEAR_X_AXIS = 0.9
"""Absolute x-component of a normal above which its tangents are made with the y-axis instead."""

PARALLEL = 1e-12
"""Sine of the angle between a normal and its goal below which the goal gives no direction."""


def tangents(normals: ArrayLike) -> tuple[Floats, Floats]:
    """Two orthogonal tangents of each normal; the angles of a cone's edges start at the first.

    The first is normal x x-axis; for normals within 26 degrees of that axis it is normal x y-axis.
    So contacts in the xy-plane have their first tangent along z. The second is normal x first.

    Args:
        normals: Unit normals, shape (..., 3).

    Returns:
        (first, second), unit vectors of that shape.
    """
    n = np.asarray(normals, dtype=np.float64)
    axis = np.where(np.abs(n[..., :1]) > NEAR_X_AXIS, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    first = unit_rows(np.cross(n, axis))
    return first, np.cross(n, first)


def edge_angles(edges: int, phase: float = 0.0) -> Floats:
    """Angles of a cone's edges about its normal [rad], counted from the first tangent, (edges,).

    Args:
        edges: Number of edges of the cone, at least 3: fewer span no cone.
        phase: Angle of the first edge [rad].

    Raises:
        SettingError: Too few edges, or a phase that is not finite.
    """
    whole = isinstance(edges, Real) and math.isfinite(edges) and edges == int(edges)
    if not whole or edges < 3:
        raise SettingError(f"a friction cone needs at least 3 edges, a whole number; got {edges!r}")
    if not math.isfinite(phase):
        raise SettingError(f"the phase of the edges must be finite; got {phase}")
    return np.linspace(phase, phase + 2.0 * math.pi, int(edges), endpoint=False)


def cone_edges(
    normals: ArrayLike, friction_angle: ArrayLike, *, edges: int = 8, phase: float = 0.0
) -> Floats:
    """Unit forces along the edges of friction cones (Wan & Howe 2018, Sec. II).

    Args:
        normals: Inward unit normals, shape (..., 3).
        friction_angle: Half-angles of the cones [rad], shape (...) or one value for all.
        edges: Number of edges of each cone.
        phase: Angle of the first edge about the normal, from the first of `tangents` [rad].

    Returns:
        Shape (..., edges, 3).

    Raises:
        SettingError: Fewer than 3 edges.
    """
    n = np.asarray(normals, dtype=np.float64)
    first, second = tangents(n)
    angles = edge_angles(edges, phase)[:, None]
    around = np.cos(angles) * first[..., None, :] + np.sin(angles) * second[..., None, :]
    beta = np.asarray(friction_angle, dtype=np.float64)[..., None, None]
    forces: Floats = np.cos(beta) * n[..., None, :] + np.sin(beta) * around
    return forces


def tilted_normals(
    normals: ArrayLike, tilt: ArrayLike, *, count: int = 8, rings: int = 1
) -> Floats:
    """Extreme normals: normals at an angle to the given ones (Wan & Howe 2018, Sec. III).

    Args:
        normals: Unit normals, shape (..., 3).
        tilt: The angle, half the sensor's resolution [rad], one value or shape (...).
        count: Number of normals on a ring, evenly around each given one.
        rings: Number of rings, at even steps up to the tilt.

    Returns:
        Shape (..., 1 + rings * count, 3), the given normal first, the innermost ring next.

    Raises:
        SettingError: Fewer than 3 normals on a ring.
    """
    n = np.asarray(normals, dtype=np.float64)
    steps = [np.asarray(tilt) * ring / rings for ring in range(1, rings + 1)]
    around = [cone_edges(n, step, edges=count) for step in steps]
    return np.concatenate([n[..., None, :], *around], axis=-2)


def turned(normals: Floats, goals: Floats, tilt: Floats) -> Floats:
    """Turn unit normals toward goal directions, by at most a tilt and not past the goals.

    Args:
        normals: Shape (..., 3).
        goals: Directions of any length, shape (..., 3); nan gives nan.
        tilt: Largest angle by which each may turn [rad], shape (...).

    Returns:
        Shape (..., 3).
    """
    finite = np.isfinite(goals).all(axis=-1, keepdims=True)
    goals = unit_rows(goals)
    cosine = (normals * goals).sum(axis=-1, keepdims=True)
    across = goals - cosine * normals
    sine = np.linalg.norm(across, axis=-1, keepdims=True)
    # Any tangent leads to a goal opposite to the normal.
    across = unit_rows(np.where(sine < PARALLEL, tangents(normals)[0], across))
    turn = np.minimum(tilt[..., None], np.arctan2(sine, cosine))
    return np.where(finite, np.cos(turn) * normals + np.sin(turn) * across, math.nan)


def on_arcs(first: Floats, second: Floats, fractions: Floats) -> Floats:
    """Unit vectors on the arcs from first unit vectors to second ones.

    Args:
        first: Shape (..., 3).
        second: Shape (..., 3); opposite vectors are joined by any arc.
        fractions: Positions along the arcs, from 0 to 1, shape (m,).

    Returns:
        Shape (..., m, 3).
    """
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    widths = np.arctan2(across, (first * second).sum(axis=-1))
    return turned(first[..., None, :], second[..., None, :], fractions * widths[..., None])


def effective_friction(friction: ArrayLike, sensor_resolution: ArrayLike) -> Floats:
    """Friction that remains at every normal within the sensor's resolution.

    Wan & Howe 2018, Sec. III-A: tan(atan(friction) - sensor_resolution / 2).

    Args:
        friction: Coulomb coefficients, at least 0, any shape.
        sensor_resolution: Angle between the two extreme normals [rad], at least 0.

    Returns:
        The coefficients; 0 where no force is within the friction cones of all normals.

    Raises:
        SettingError: A value is outside its range.
    """
    try:
        mu, alpha = np.asarray(friction, np.float64), np.asarray(sensor_resolution, np.float64)
    except (TypeError, ValueError) as error:
        raise SettingError(f"friction and resolution must be numbers: {error}") from error
    if not ((mu >= 0.0) & np.isfinite(mu)).all():
        raise SettingError(f"friction must be finite and at least 0; got {mu}")
    if not ((alpha >= 0.0) & np.isfinite(alpha)).all():
        raise SettingError(f"sensor resolution must be finite and at least 0; got {alpha}")
    return np.asarray(np.tan(np.maximum(np.arctan(mu) - alpha / 2.0, 0.0)))[()]


PAD_POINTS = 8
"""Points at which a soft finger presses; see `Contacts.as_points`."""

LARGEST = 1e100
"""Largest coordinate; the squares of larger ones could overflow."""


@dataclass(frozen=True, eq=False, init=False)
class Contacts:
    """Contacts of one grasp, or of many with the same number of fingers.

    Leading axes (...) are a batch; results have one value per grasp. Lengths may be in another unit
    than metres; torques then are in newtons times that unit.

    Example:
        Two fingers on opposite sides of a cube with edges of length 2:

        >>> import grasp3d
        >>> points, normals = [[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
        >>> contacts = grasp3d.Contacts(points, normals, friction=0.5)
        >>> contacts.count, contacts.batch, contacts.friction_angle.round(3).tolist()
        (2, (), [0.464, 0.464])
    """

    points: Floats
    """Contact points relative to the centre of mass [m], shape (..., n, 3)."""
    normals: Floats
    """Unit normals pointing into the object, shape (..., n, 3)."""
    friction: Floats
    """Coulomb coefficients, shape (..., n)."""
    torsion_radius: Floats
    """Largest torsional moment about the normal per normal force [m], shape (..., n);
    0: a hard finger."""
    groups: Ints | None
    """The finger of each contact, from 0, shape (n,); None: each contact is a finger. Contacts of
    one finger, such as the corners of a patch that a pad touches, share the bound on its force in
    epsilon, grip forces and payloads. Labels exist for single points only."""

    __repr__ = short_repr

    def __init__(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        friction: ArrayLike = 0.5,
        torsion_radius: ArrayLike = 0.0,
        groups: ArrayLike | None = None,
    ) -> None:
        """Check and copy the arrays.

        Args:
            points: Shape (..., n, 3), relative to the centre of mass.
            normals: Inward normals of the same shape; they are scaled to length 1.
            friction: Coulomb coefficients, at least 0: one value, or shape (..., n).
            torsion_radius: Soft fingers: uniform pressure on a disc of radius r under Coulomb
                friction resists a torsional moment of up to 2/3 friction r per normal force, so
                give 2/3 * friction * r. One value, or shape (..., n).
            groups: The finger of each contact, from 0, shape (n,), if fingers touch at several
                points, which must be hard; None: each contact is a finger.

        Raises:
            ContactError: Shapes do not match, or values are out of range.
        """
        p = finite_numbers("points", points, most=LARGEST)
        n = finite_numbers("normals", normals)
        if p.ndim < 2 or p.shape[-1] != 3 or p.shape[-2] == 0:
            raise ContactError(f"points must have shape (..., n, 3), n >= 1; got {p.shape}")
        if n.shape != p.shape:
            raise ContactError(f"normals must have the shape of points {p.shape}; got {n.shape}")
        largest = np.abs(n).max(axis=-1, keepdims=True)
        if not (largest > 0.0).all():
            where = tuple(int(i) for i in np.argwhere(largest[..., 0] == 0.0)[0])
            raise ContactError(f"the normal of contact {where} has length 0")
        n = n / largest  # squares of very large or small numbers would overflow or underflow
        lengths = np.linalg.norm(n, axis=-1, keepdims=True)
        object.__setattr__(self, "points", locked(p))
        object.__setattr__(self, "normals", locked(n / lengths))
        for name, value in (("friction", friction), ("torsion_radius", torsion_radius)):
            values = finite_numbers(name, value)
            if (values < 0.0).any():
                raise ContactError(f"{name} must be at least 0; got {values.min():g}")
            object.__setattr__(
                self, name, locked(of_shape(name, values, p.shape[:-1], ContactError))
            )
        object.__setattr__(self, "groups", None if groups is None else self._checked(groups))

    def _checked(self, groups: ArrayLike) -> Ints:
        """Check the finger of each contact, (n,). Raises ContactError."""
        try:
            fingers = np.asarray(groups)
        except ValueError as error:
            raise ContactError(f"groups must be a row of whole numbers; got {groups!r}") from error
        if fingers.shape != (self.count,) or not np.issubdtype(fingers.dtype, np.integer):
            raise ContactError(
                f"groups must be the number of each contact's finger, shape ({self.count},); "
                f"got {groups!r}"
            )
        if not np.array_equal(np.unique(fingers), np.arange(fingers.max() + 1)):
            raise ContactError(f"fingers must be numbered from 0 without a gap; got {groups!r}")
        if self.torsion_radius.any():
            raise ContactError(
                "a finger that touches at several points resists torsion by them: leave "
                "torsion_radius 0"
            )
        return locked(fingers.astype(np.int64))

    @property
    def friction_angle(self) -> Floats:
        """Half-angles of the friction cones [rad], shape (..., n)."""
        return np.arctan(self.friction)

    def with_friction(self, friction: ArrayLike) -> "Contacts":
        """The same contacts with other friction coefficients: one value, or shape (..., n)."""
        return Contacts(self.points, self.normals, friction, self.torsion_radius, self.groups)

    def by_finger(self) -> tuple[Ints, int]:
        """Order contacts by finger, with equally many contacts for each finger.

        Returns:
            (contacts (p,), number for each finger). If a finger has fewer contacts, its first is
            repeated, which does not change the forces that it can apply.
        """
        if self.groups is None:
            return np.arange(self.count), 1
        fingers = [np.flatnonzero(self.groups == finger) for finger in np.unique(self.groups)]
        most = max(map(len, fingers))
        rows = [np.append(own, np.full(most - len(own), own[0])) for own in fingers]
        return np.concatenate(rows), most

    def as_points(self) -> "Contacts":
        """Replace soft fingers by the points at which they press: hard contacts in groups.

        An evenly pressed disc of radius r resists the same torsion about its normal as points at a
        distance of 2/3 r that share its force. This distance is the torsion radius divided by
        friction. Each finger has `PAD_POINTS` points, in the plane perpendicular to its normal.
        """
        if not self.torsion_radius.any():
            return self
        friction = np.where(self.friction > 0.0, self.friction, math.inf)
        radius = (self.torsion_radius / friction)[..., None, None]
        angles = edge_angles(PAD_POINTS)[:, None]
        across, along = (vectors[..., None, :] for vectors in tangents(self.normals))
        rings = self.points[..., None, :] + radius * (
            np.cos(angles) * across + np.sin(angles) * along
        )
        return Contacts(
            rings.reshape(*self.batch, -1, 3),
            self.normals.repeat(PAD_POINTS, axis=-2),
            self.friction.repeat(PAD_POINTS, axis=-1),
            groups=np.arange(self.count).repeat(PAD_POINTS),
        )

    def of_size(self, points: Floats, size: Floats) -> "Contacts":
        """The same contacts at other points, with torsion radii divided by a size of each grasp.

        Args:
            points: Shape (..., n, 3).
            size: Shape (...).
        """
        return self._changed(points=points, torsion_radius=self.torsion_radius / size[..., None])

    def ordered(self, which: Ints) -> "Contacts":
        """The contacts in the order (p,) of `by_finger`, each as a finger of its own."""
        if self.groups is None and len(which) == self.count:
            return self
        axis = len(self.batch)
        columns = {name: getattr(self, name).take(which, axis) for name in _COLUMNS}
        return self._changed(**columns, groups=None)

    def reshape(self, batch: tuple[int, ...]) -> "Contacts":
        """The same grasps in a batch of another shape, of which one number may be -1."""
        return self._each(lambda values, rest: values.reshape(*batch, *rest))

    def take(self, which: slice | Ints) -> "Contacts":
        """The chosen grasps along the first axis of the batch."""
        return self._each(lambda values, _: values[which])

    def _each(self, change: Callable[[Floats, tuple[int, ...]], Floats]) -> "Contacts":
        """Apply `change(values, other axes)` to every field, to change the batch axes."""
        columns = (getattr(self, name) for name in _COLUMNS)
        changed = (change(values, values.shape[len(self.batch) :]) for values in columns)
        return self._changed(**dict(zip(_COLUMNS, changed, strict=True)))

    def _changed(self, **columns: Floats | None) -> "Contacts":
        """The same contacts with other fields, which are not checked again."""
        contacts = object.__new__(Contacts)
        for name in (*_COLUMNS, "groups"):
            values = columns.get(name, getattr(self, name))
            object.__setattr__(contacts, name, values if values is None else locked(values))
        return contacts

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the batch; () for a single grasp."""
        return self.points.shape[:-2]

    @property
    def count(self) -> int:
        """Number of contacts of each grasp."""
        return int(self.points.shape[-2])


_COLUMNS = ("points", "normals", "friction", "torsion_radius")


def finite_numbers(
    name: str,
    values: ArrayLike,
    kind: type[GraspError] = ContactError,
    *,
    most: float = sys.float_info.max,
) -> Floats:
    """Convert to an array of finite numbers.

    Args:
        name: What they are, for the error message.
        values: The numbers.
        kind: Class of the error.
        most: Largest number, positive or negative.

    Raises:
        GraspError: Values are not finite numbers, or too large.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise kind(f"{name} must be an array of numbers: {error}") from error
    if (np.abs(array) <= most).all():
        return array
    missing = np.argwhere(~np.isfinite(array))
    if not len(missing):
        raise kind(f"{name} must not exceed {most:g}; got {np.abs(array).max():g}")
    where = tuple(int(i) for i in missing[0])
    raise kind(f"{name} must be finite; {array[where]} at {where}")


def of_shape(
    name: str, numbers: Floats, shape: tuple[int, ...], kind: type[GraspError] = SettingError
) -> Floats:
    """Broadcast numbers to a shape.

    Args:
        name: What they are, for the error message.
        numbers: One for all, or of a shape that fits.
        shape: The shape.
        kind: Class of the error.

    Raises:
        GraspError: Their shape does not fit.
    """
    try:
        # A full array takes less time than a view of one number.
        return np.broadcast_to(numbers, shape) if numbers.ndim else np.full(shape, numbers)
    except ValueError as error:
        raise kind(
            f"{name} must be one number or have shape {shape}; got {numbers.shape}"
        ) from error


def per_contact(name: str, values: ArrayLike, contacts: Contacts) -> Floats:
    """Broadcast a setting to one value per contact.

    Args:
        name: Name of the setting, for the error message.
        values: Finite numbers: one value, or shape (..., n).
        contacts: The contacts.

    Returns:
        Shape (..., n).

    Raises:
        SettingError: Values are not finite numbers, or their shape does not match.
    """
    return of_shape(name, finite_numbers(name, values, SettingError), contacts.friction.shape)


def tilts_of(tilt: ArrayLike, contacts: Contacts) -> Floats:
    """Largest tilts of the contacts' normals for a flat batch, shape (b, n).

    Args:
        tilt: From 0 to below pi/2 [rad]: one value, or shape (..., n).
        contacts: The contacts.

    Raises:
        SettingError: A value is outside its range, or the shape does not match.
    """
    tilts = per_contact("tilt", tilt, contacts).reshape(-1, contacts.count)
    if not ((tilts >= 0.0) & (tilts < RIGHT_ANGLE)).all():
        raise SettingError(f"tilt must be from 0 to below pi/2; got {tilts}")
    return tilts


def centred(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Points relative to their mean and divided by their size; closure depends on neither.

    Args:
        points: Shape (..., n, 3).

    Returns:
        (points, mean (..., 1, 3), size (..., 1, 1)); the size is the largest distance from the
        mean, or 1 where that is 0.
    """
    offsets = np.array(points, order="C")
    mean, size = np.empty((*points.shape[:-2], 1, 3)), np.empty((*points.shape[:-2], 1, 1))
    centre(offsets.reshape(-1, *points.shape[-2:]), mean.reshape(-1, 3), size.reshape(-1))
    return offsets, mean, size


def evenly_pressed_radius(half_extents: Floats, area: Floats) -> Floats:
    """Mean distance of a patch's points from its centre: the torsion radius per friction.

    About the normal through its centre, an evenly pressed patch resists friction times normal force
    times this distance: the perimeter / (3 pi) for an ellipse, 2/3 r for a disc. The patch is
    treated as the ellipse with its area and the proportions of its extents. This is exact for
    ellipses, 2 to 4 % too small for rectangles, and never less than for a disc of that area, which
    of all shapes resists least.

    Args:
        half_extents: Half of the patch's extents along two orthogonal directions, at least 0, shape
            (..., 2).
        area: Shape (...).

    Returns:
        Lengths, shape (...); 0 where the area is 0 or both extents are.

    Example:
        A square with sides of 2: on average its points are 0.765 from the centre.

        >>> import numpy as np
        >>> from grasp3d.contact.contacts import evenly_pressed_radius
        >>> print(f"{evenly_pressed_radius(np.ones(2), np.array(4.0)):.3f}")
        0.752
    """
    long, short = half_extents.max(axis=-1), half_extents.min(axis=-1)
    enclosed = math.pi * long * short
    # A patch thinner than rounding is a line of length 2 a, on average a/2 from its middle.
    thin = enclosed <= 1e-12 * long * long
    safe = np.where(long > 0.0, long, 1.0)
    from scipy.special import ellipe

    perimeter = 4.0 * long * ellipe(1.0 - (short / safe) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.sqrt(area / enclosed) * perimeter / (3.0 * math.pi)
    return np.asarray(np.where(area > 0.0, np.where(thin, 0.5 * long, scaled), 0.0))[()]
