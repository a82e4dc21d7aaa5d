"""Budgets of margins for the grasps of a model: which of its uncertainties costs the most."""

import math

import numpy as np

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.contact.budget import MarginBudget
from grasp3d.settings import GraspModel
from grasp3d.settings.uncertainty import Uncertainty


def margin_budget(
    model: GraspModel, critical_angle: ArrayLike, located_angle: ArrayLike | None = None
) -> MarginBudget:
    """Parts of the friction angle of each grasp, whose margin decides on the label.

    Where fingers differ, the parts are those of the worst finger, and what the other fingers have
    better is taken off `location`. A model states one normal error, whatever its causes are, so
    `encoders` is 0.

    Args:
        model: Friction, sensor resolution and errors.
        critical_angle: Critical friction angle over the worst normals [rad], shape (...); inf: no
            grasp.
        located_angle: The same with uncertain locations, such as
            `SurfaceLabels.located_angles[0]`; None: locations are exact.

    Returns:
        The budget; its `margin` is `model.effective_friction_angle` minus the located angle, and
        -inf where there is no grasp.

    Example:
        >>> import grasp3d
        >>> from grasp3d.stability import margin_budget
        >>> model = grasp3d.GraspModel(friction="0.4..0.6", sensor_resolution=0.2)
        >>> budget = margin_budget(model, [0.0, 0.3])
        >>> budget.margin.round(3), budget.costliest
        (array([ 0.281, -0.019]), array(['sensor resolution', 'sensor resolution'], dtype='<U17'))
    """
    worst = _worst_finger(model)
    smallest, largest = worst.friction or model.friction_interval
    beta = math.atan(0.5 * (smallest + largest))
    critical = np.asarray(critical_angle, dtype=np.float64)
    return MarginBudget(
        friction_angle=np.asarray(beta),
        critical_angle=critical,
        friction=np.asarray(beta - math.atan(smallest)),
        resolution=np.asarray((model.sensor_resolution + worst.sensor_resolution) / 2.0),
        normals=np.asarray(model.normal_error + worst.normal_error),
        location=_difference(critical, located_angle),
        encoders=np.zeros(()),
    )


def _worst_finger(model: GraspModel) -> Uncertainty:
    """Own uncertainty of the finger that leaves the least friction angle."""
    fingers = model.per_finger or (Uncertainty(),)
    return min(
        fingers,
        key=lambda own: (
            math.atan((own.friction or model.friction_interval)[0])
            - (own.sensor_resolution / 2.0 + own.normal_error)
        ),
    )


def _difference(critical: Floats, located: ArrayLike | None) -> Floats:
    if located is None:
        return np.zeros(critical.shape)
    found = np.isfinite(critical)
    return np.where(found, np.asarray(located) - np.where(found, critical, 0.0), 0.0)
