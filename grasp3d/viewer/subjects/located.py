"""Critical angles that include uncertain contact locations and differences of the fingers."""

from dataclasses import dataclass, replace

import numpy as np

from grasp3d.arrays import Floats, locked, short_repr
from grasp3d.settings import GraspModel
from grasp3d.stability.located_angles import ContactLimits
from grasp3d.surface.contacts import GraspContacts
from grasp3d.surface.grasp_numbers import located_angles_of
from grasp3d.surface.labels import SurfaceLabels

PAIR = 2


@dataclass(frozen=True, eq=False)
class Located:
    """Located angles of every vertex's grasp; see `stability.located_angles`."""

    worst: Floats
    """Over the worst normals and contact points [rad]; inf: no grasp. (V,)"""
    best: Floats
    """Over the best ones, (V,)."""
    key: object
    """What they depend on, see `dependence`."""

    __repr__ = short_repr

    @classmethod
    def of(cls, labels: SurfaceLabels, model: GraspModel) -> "Located":
        """Located angles of labels for a model.

        Raises:
            SettingError: The model is for another number of fingers.
        """
        worst, best = labels.using(model=model).located_angles
        # A file has no second grasp, of the best normals at a crease, whose line could be turned:
        # what the worst finger adds to its angle is a bound.
        added = ContactLimits.of(model.fingertips).outer.max()
        bound = labels.critical_angle_best + added
        return cls(worst, locked(np.minimum(best, bound)), dependence(model))


def dependence(model: GraspModel) -> object:
    """What located angles depend on: of equal fingers the location error alone.

    The thresholds that they are compared with have all that the fingers have in common.
    """
    return model if model.per_finger else model.location_error


def fits(model: GraspModel) -> bool:
    """Whether the values of single fingers are for the model's number of fingers."""
    return not model.per_finger or len(model.per_finger) == model.fingers


def located_grasp(
    grasp: GraspContacts, worst: float, best: float, model: GraspModel
) -> tuple[float, float]:
    """Angles that decide the label of one grasp, over the worst and the best normals [rad].

    Args:
        grasp: The grasp, shape (1, n).
        worst: Its critical angle over the worst normals [rad].
        best: The same over the best normals.
        model: Grasp model, with lengths in the mesh's unit.
    """
    model = replace(model, fingers=grasp.count)
    if model.is_uniform or not fits(model):
        return float(worst), float(best)
    angles = np.array([worst]), np.array([best])
    found = located_angles_of(grasp, angles, model, threads=1)
    return float(found[0][0]), float(found[1][0])
