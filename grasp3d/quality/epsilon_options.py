"""Options of epsilon, common to all functions that compute wrench hulls."""

import math
from dataclasses import dataclass

from grasp3d.contact.friction_cones import edge_angles
from grasp3d.errors import SettingError
from grasp3d.quality.wrenches import check_torque_scale
from grasp3d.settings import GraspModel, check_choice
from grasp3d.settings.grasp_model import Actuation

Goal = tuple[float, float, float, float]
"""When a hull need not be grown further: relative and absolute tolerance of the bounds, cutoff, and
whether only the sign is needed; see `_kernels.hull.growing_hull.grow`."""

UNDECIDED_WITHIN = 1e4
"""Width, in tolerances of 1e-12 of the wrenches, of an interval about 0 that is left undecided."""


@dataclass(frozen=True)
class EpsilonOptions:
    """Cones, actuation, torque scale and accuracy of epsilon (Ferrari & Canny 1992).

    Attributes:
        edges: Edges of polygonal friction cones; None: circular cones.
        actuation: 'total': the sum of all forces is at most 1 (the hull of the contacts' wrenches);
            'per_finger': each finger's force is (the Minkowski sum).
        torque_scale: Length that torques are divided by [mesh unit]; `ObjectMesh.torque_scale`
            makes epsilon independent of the unit.
        rtol: Circular cones: largest difference of the bounds, as a fraction of the upper one.
        threads: Threads for a batch; None: one per processor.

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
    threads: int | None = None

    def __post_init__(self) -> None:
        check_choice("actuation", self.actuation, Actuation)
        check_torque_scale(self.torque_scale)
        if not 0.0 < self.rtol < 1.0:
            raise SettingError(f"rtol must lie between 0 and 1; got {self.rtol}")
        if self.edges is not None:
            edge_angles(self.edges)  # raises SettingError
        if self.threads is not None and self.threads < 1:
            raise SettingError(f"threads must be at least 1; got {self.threads}")

    @classmethod
    def of_model(
        cls, model: GraspModel, *, torque_scale: float, rtol: float, threads: int | None
    ) -> "EpsilonOptions":
        """The options of a model for an object of known torque scale."""
        return cls(model.edges, model.actuation, torque_scale, rtol, threads)

    @property
    def polygonal(self) -> bool:
        """Whether cones are polygons, so that epsilon has an exact value."""
        return self.edges is not None

    @property
    def goal(self) -> Goal:
        """How close the bounds must be, as `WrenchProblem.solve` takes it."""
        tolerances = (0.0, 0.0) if self.polygonal else (self.rtol, UNDECIDED_WITHIN)
        return (*tolerances, math.inf, 0.0)
