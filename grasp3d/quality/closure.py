"""Force closure of grasps, with its proof."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.wrench_problem import SIGN
from grasp3d.arrays import Bools, Bytes, Ints, shaped
from grasp3d.contact.contacts import Contacts, centred
from grasp3d.quality.certificates import Certificate, certificate_of, contact_forces
from grasp3d.quality.wrench_problem import WrenchProblem


@dataclass(frozen=True, eq=False)
class ForceClosure:
    """Whether grasps are in force closure."""

    closed: Bools
    """Shape (...)."""
    rank: Ints
    """Dimensions in which they are, shape (...)."""
    status: Bytes
    """`Status` codes, shape (...)."""
    certificate: Certificate


def force_closure(
    contacts: Contacts,
    *,
    edges: int | None = None,
    cone_offset: npt.ArrayLike = 0.0,
    phase: float = 0.0,
    threads: int | None = 1,
) -> ForceClosure:
    """Whether grasps resist every wrench in their span, with proof.

    It depends neither on the centre of mass nor on a torque scale; the direction of the certificate
    is one for a torque scale of 1.

    Args:
        contacts: The contacts.
        edges: Edges of polygonal friction cones; None: circular cones.
        cone_offset: Angle added to the cones' half-angles [rad], one or shape (..., n).
        phase: As in `epsilon`.
        threads: Threads for a batch; None: one per processor.

    Raises:
        SettingError: A setting outside its range.
    """
    points, middle, size = centred(contacts.points)  # far from the origin digits are lost
    torsion = contacts.torsion_radius / size[..., 0]
    near = Contacts(points, contacts.normals, contacts.friction, torsion)
    problem = WrenchProblem.of_contacts(
        near, edges, "total", torque_scale=1.0, cone_offset=cone_offset, phase=phase
    )
    answers = problem.solve(SIGN, threads=threads)
    u = answers.direction
    u[:, 3:] /= size.reshape(-1, 1)
    u[:, :3] -= np.cross(u[:, 3:], middle.reshape(-1, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    batch = contacts.batch
    return ForceClosure(
        closed=shaped(answers.closed, batch),
        rank=shaped(answers.rank, batch),
        status=shaped(answers.status, batch),
        certificate=certificate_of(answers, batch, contact_forces(contacts, answers.forces)),
    )
