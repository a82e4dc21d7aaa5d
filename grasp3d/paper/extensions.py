"""Beside the paper's figures: fractions over the uncertainties that it names but works out no more.

Wan & Howe 2018, Sec. III-A and IV-B: friction, contact location and joint encoders.
"""

import math

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.paper.true_grasps import sampled_fractions
from grasp3d.planar import Circle
from grasp3d.plots.error_fractions import ErrorPanel, error_fractions_figure
from grasp3d.plots.heat_maps import heat_map_figure
from grasp3d.plots.style import Drawing
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.sweeps import Sweep, sweep

STEPS = 120
"""Steps of the swept uncertainties."""
SAMPLED = 5
"""Values of each uncertainty at which fractions are sampled."""
NORMAL_ERROR = 15.0 * DEGREE
"""Largest further error of normals [rad]."""
FRICTION_ERROR = 0.5
"""Largest friction error, as a fraction of the friction."""
CONTOURS = (0.1, 0.25, 0.4)
"""Fractions S that are drawn as lines."""


def over_errors(settings: PaperSettings) -> Drawing:
    """Draw fractions of the circle over location, friction and normal errors, in closed form."""
    model = settings.models[0]
    panels = [
        _panel(model, "location_error", largest_location(model), "location error [radii]"),
        _panel(model, "friction_error", FRICTION_ERROR * model.friction, r"friction error $\pm$"),
        _panel(model, "normal_error", NORMAL_ERROR, "further error of normals [°]"),
    ]
    degrees = math.degrees(model.sensor_resolution)
    return error_fractions_figure(
        panels,
        title=rf"circle, $\mu$ = {model.friction:g}, $\alpha$ = {degrees:.4g}°, "
        "the other errors 0",
        label="fraction of the perimeter",
    )


def over_resolution_and_location(settings: PaperSettings) -> Drawing:
    """Draw S and M of the circle over resolution and location error, as maps."""
    return heat_map_figure([resolution_and_location(settings)], fractions=CONTOURS)


def resolution_and_location(settings: PaperSettings) -> Sweep:
    """Fractions of the circle over resolution and location error, in radii, up to where S ends."""
    exact = GraspModel(friction=settings.friction, sensor_resolution=0.0)
    return sweep(
        Circle(),
        friction=settings.friction,
        sensor_resolution=np.linspace(0.0, 2.0 * exact.friction_angle, STEPS + 1),
        location_error=np.linspace(0.0, largest_location(exact), STEPS + 1),
        name="circle of radius 1",
        mode="scan",
    )


def largest_location(model: GraspModel) -> float:
    """Location error from which on no grasp of a circle of radius 1 is S; at least 0.05.

    The fingers opposite each other are S while asin(error) < beta - alpha / 2.
    """
    return max(0.05, math.sin(max(model.effective_friction_angle, 0.0)))


def _panel(model: GraspModel, name: str, largest: float, title: str) -> ErrorPanel:
    """Fractions over one uncertainty from 0 to the largest, and sampled ones at a few."""
    values = np.linspace(0.0, largest, STEPS + 1)
    found = sweep(
        Circle(),
        friction=model.friction,
        sensor_resolution=model.sensor_resolution,
        name="circle",
        mode="scan",
        **{name: values},
    )
    return ErrorPanel(found, title, _sampled(model, name, values[:: STEPS // SAMPLED]))


def _sampled(model: GraspModel, name: str, values: Floats) -> list[tuple[float, float, float]]:
    in_degrees = name == "normal_error"
    sampled = []
    for value in values.tolist():
        settings = {
            "friction": model.friction,
            "sensor_resolution": model.sensor_resolution,
            name: value,
        }
        shown = math.degrees(value) if in_degrees else value
        sampled.append((shown, *sampled_fractions(GraspModel(**settings))))
    return sampled
