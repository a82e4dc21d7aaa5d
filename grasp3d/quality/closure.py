"""Force closure of grasps, with certificates, which epsilon has as well."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, partial
from typing import Any

import numpy as np

from grasp3d._kernels.hull import growing_hull
from grasp3d._kernels.hull.wrench_problem import SIGN, Results
from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, shaped, short_repr, unit_rows
from grasp3d.contact.contacts import Contacts, centred
from grasp3d.contact.friction_cones import tangents
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import EpsilonOptions


class Status(IntEnum):
    """How a computation ended."""

    CONVERGED = growing_hull.CONVERGED
    """Within the requested tolerance."""
    UNDECIDED = growing_hull.UNDECIDED
    """Force closure is not decided: the hull contains no ball of 1e-8 of the largest wrench, and no
    direction was found in which wrenches reach at most 1e-12 of it; or tilts exceed friction (see
    `cone_offset`)."""
    STALLED = growing_hull.STALLED
    """Rounding errors stopped the search; the interval is valid."""
    EXHAUSTED = growing_hull.EXHAUSTED
    """The hull needed too much memory; the interval reached so far is valid."""


@dataclass(frozen=True, eq=False)
class Certificate:
    """Proof of a result, which linear algebra can verify."""

    _direct: Callable[[], Floats]
    """Computes `direction`."""
    _balance: Callable[[], Floats]
    """Computes `equilibrium`."""

    __repr__ = short_repr

    @cached_property
    def direction(self) -> Floats:
        """Unit direction, shape (..., 6), computed when it is first read.

        If the grasp is not force-closed, the direction separates it from the origin: no wrench of
        any contact has a positive component along it. If it is, the disturbance that is hardest to
        resist acts against it: the support function of the grasp wrench space is `upper` there. In
        a `ForceClosure` it is meaningful only where not force-closed.
        """
        return self._direct()

    @cached_property
    def equilibrium(self) -> Floats:
        """Forces in equilibrium, computed when they are first read.

        If the grasp is force-closed, nonzero forces in equilibrium, each inside its friction cone,
        shape (..., n, 4): force along x, y, z, and torsional moment about the normal [m].
        For given wrenches their weights, shape (..., n). nan where not force-closed, and where
        `cone_offset` makes cones of 90 degrees or more. Copies and pickles hold the forces.
        """
        return self._balance()

    def __reduce__(self) -> tuple[Any, ...]:
        return Certificate, (
            partial(np.asarray, self.direction), partial(np.asarray, self.equilibrium),
        )  # fmt: skip


def forces_of_components(
    contacts: Contacts, components: Floats, order: Ints | None = None
) -> Floats:
    """Forces along x, y, z and moments from components along the contacts' axes.

    Args:
        contacts: The contacts.
        components: Shape (b, p, 4).
        order: The contact of each row of components, as of `Contacts.by_finger`, shape (p,); None:
            one of each contact.

    Returns:
        Forces and torsional moments, shape (b, n, 4).
    """
    if order is not None:
        rows, components = components, np.zeros((len(components), contacts.count, 4))
        for row, contact in enumerate(order):
            components[:, contact] += rows[:, row]
    normals = contacts.normals.reshape(*components.shape[:2], 3)
    axes = np.stack([normals, *tangents(normals)], axis=-2)  # (b, n, 3, 3)
    forces = (components[..., None, :3] @ axes)[..., 0, :]
    twist = components[..., 3] * contacts.torsion_radius.reshape(components.shape[:2])
    return np.concatenate([forces, twist[..., None]], axis=-1)


@dataclass(frozen=True, eq=False)
class ForceClosure:
    """Force closure of grasps."""

    closed: Bools
    """Whether the grasp is force-closed, shape (...)."""
    rank: Ints
    """Dimension of the span of the grasp's wrenches, shape (...)."""
    status: Bytes
    """`Status` codes, shape (...)."""
    certificate: Certificate

    __repr__ = short_repr


def closure_fields(
    problem: WrenchProblem,
    results: Results,
    batch: tuple[int, ...],
    forces_of: Callable[[Floats], Floats],
    directions_of: Callable[[Floats], Floats] = np.asarray,
) -> dict[str, Any]:
    """Fields of `ForceClosure`.

    Args:
        problem: The wrench spaces of a flat batch.
        results: Their results.
        batch: Shape of the batch.
        forces_of: Converts balanced forces along the contacts' axes.
        directions_of: Converts the directions of results.
    """
    return {
        "closed": shaped(results.closed, batch),
        "rank": shaped(results.rank, batch),
        "status": shaped(results.status, batch),
        "certificate": Certificate(
            lambda: shaped(directions_of(results.direction), batch),
            lambda: shaped(forces_of(problem.balanced_forces(results.closed)), batch),
        ),
    }


def force_closure(
    contacts: Contacts,
    *,
    edges: int | None = None,
    cone_offset: ArrayLike = 0.0,
    phase: float = 0.0,
) -> ForceClosure:
    """Whether grasps resist every wrench in the span of their own, with certificates.

    A grasp is force-closed if its wrenches contain a ball about the origin of 1e-8 of the largest
    one. It surely is not if in some direction none reaches farther than 1e-12 of that. What lies
    between is undecided, and counts as not force-closed.

    The result depends neither on the centre of mass nor on a torque scale; the direction of the
    certificate is that for a torque scale of 1.

    Args:
        contacts: The contacts.
        edges: Edges of polygonal friction cones; None: circular cones.
        cone_offset: Angle added to the cones' half-angles [rad], one value or shape (..., n);
            where one becomes negative, tilts exceed friction: nothing is decided.
        phase: As in `epsilon`.

    Raises:
        SettingError: A setting outside its range.

    Example:
        Two opposing fingers, and two that push in the same direction:

        >>> import grasp3d
        >>> points = [[-1, 0, 0], [1, 0, 0]]
        >>> normals = [[[1, 0, 0], [-1, 0, 0]], [[1, 0, 0], [1, 0, 0]]]
        >>> found = grasp3d.force_closure(grasp3d.Contacts([points, points], normals))
        >>> found.closed.tolist(), found.rank.tolist()
        ([True, False], [5, 5])
    """
    points, mean, size = centred(contacts.points)  # far from the origin precision is lost
    scaled = contacts.of_size(points, size[..., 0, 0])
    problem = WrenchProblem.of_contacts(
        scaled, EpsilonOptions(edges), cone_offset=cone_offset, phase=phase
    )

    def about_origin(directions: Floats) -> Floats:
        forces, torques = directions[:, :3], directions[:, 3:] / size.reshape(-1, 1)
        forces = forces - np.cross(torques, mean.reshape(-1, 3))
        return unit_rows(np.concatenate([forces, torques], axis=1))

    forces_of, results = partial(forces_of_components, contacts), problem.solve(SIGN)
    fields = closure_fields(problem, results, contacts.batch, forces_of, about_origin)
    return ForceClosure(**fields)
