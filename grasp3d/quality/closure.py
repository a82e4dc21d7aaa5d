"""Force closure of grasps, with certificates."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from grasp3d._kernels.wrench_problem import SIGN
from grasp3d.arrays import ArrayLike, Bools, Bytes, Ints, shaped, short_repr
from grasp3d.contact.contacts import Contacts, centred
from grasp3d.quality.certificates import Certificate, certificate_of, forces_of_components
from grasp3d.quality.epsilon_options import EpsilonOptions
from grasp3d.quality.wrench_problem import WrenchProblem


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


def force_closure(
    contacts: Contacts,
    *,
    edges: int | None = None,
    cone_offset: ArrayLike = 0.0,
    phase: float = 0.0,
    threads: int | None = None,
) -> ForceClosure:
    """Whether grasps resist every wrench in the span of their own, with certificates.

    Depends neither on the centre of mass nor on a torque scale; the direction of the certificate is
    that for a torque scale of 1.

    Args:
        contacts: The contacts; patches resist rolling, as for `epsilon`.
        edges: Edges of polygonal friction cones; None: circular cones.
        cone_offset: Angle added to the cones' half-angles [rad], one value or shape (..., n).
        phase: As in `epsilon`.
        threads: Threads for a batch; None: one per processor.

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
    results = problem.solve(SIGN, with_forces=False, threads=threads)
    u = results.direction
    u[:, 3:] /= size.reshape(-1, 1)
    u[:, :3] -= np.cross(u[:, 3:], mean.reshape(-1, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    batch = contacts.batch
    return ForceClosure(
        closed=shaped(results.closed, batch),
        rank=shaped(results.rank, batch),
        status=shaped(results.status, batch),
        certificate=certificate_of(
            problem,
            results,
            SIGN,
            batch=batch,
            forces_of=partial(forces_of_components, contacts),
            threads=threads,
        ),
    )
