"""Figures 4 to 11 of Wan & Howe 2018, and two beside them, one function each."""

from collections.abc import Callable

from grasp3d.contact.sensor import Sensor
from grasp3d.paper.extensions import over_errors, over_resolution_and_location
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.planar import Circle, Outline, scan, square
from grasp3d.plots.combinations import combinations_figure
from grasp3d.plots.cones import cone_figure
from grasp3d.plots.curves import curves_figure
from grasp3d.plots.fraction_figures import ceiling_figure, fractions_figure
from grasp3d.plots.style import Drawing
from grasp3d.plots.tips import tips_figure
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles
from grasp3d.sweeps import Sweep, sweep

CONE_MODEL = GraspModel(friction=1.0, sensor_resolution=30.0 * DEGREE)
"""Model of the drawings of cones for all settings: all its angles are clearly visible."""

TIP = Sensor(receptive_field=4.0, fingertip_radius=10.0)
"""The paper's hemispherical tip, with the receptive field that it needs at friction 0.2 [mm]."""


def tips(_: PaperSettings) -> Drawing:
    """Draw a counterpart of Fig. 4: receptive fields of a flat and a round tip."""
    return tips_figure(TIP)


def cone(_: PaperSettings) -> Drawing:
    """Draw Fig. 5: the cones of one contact."""
    return cone_figure(CONE_MODEL)


def combinations(_: PaperSettings) -> Drawing:
    """Draw Fig. 6: a grasp under the four combinations of extreme cones."""
    return combinations_figure(CONE_MODEL)


def circle_curves(settings: PaperSettings) -> Drawing:
    """Draw Fig. 7: epsilon around the circle."""
    return curves_figure([scan(Circle(), model) for model in settings.models], over="angle")


def circle_fractions(settings: PaperSettings) -> Drawing:
    """Draw Fig. 8: fractions of the circle over the resolution."""
    return fractions_figure(swept(Circle(), settings))


def square_curves(settings: PaperSettings) -> Drawing:
    """Draw Fig. 9: epsilon along the square."""
    scans = [scan(square(), model) for model in settings.models]
    return curves_figure(scans, over="position", unit="half sides")


def square_fractions(settings: PaperSettings) -> Drawing:
    """Draw Fig. 10: fractions of the square over the resolution."""
    return fractions_figure(swept(square(), settings))


def ceilings(settings: PaperSettings) -> Drawing:
    """Draw Fig. 11: the best possible accuracy of a learned predictor.

    The paper's curve is that of the sphere, by area; those of circle and square, by perimeter, are
    for comparison.
    """
    sphere = swept(SphereAngles(), settings, name="sphere (the paper's)")
    return ceiling_figure([sphere, *(swept(outline, settings) for outline in (Circle(), square()))])


FIGURES: dict[str, Callable[[PaperSettings], Drawing]] = {
    "figure_04": tips,
    "figure_05": cone,
    "figure_06": combinations,
    "figure_07": circle_curves,
    "figure_08": circle_fractions,
    "figure_09": square_curves,
    "figure_10": square_fractions,
    "figure_11": ceilings,
    "extension_errors": over_errors,
    "extension_map": over_resolution_and_location,
}
"""Functions that draw the figures, by the name of their files without suffix."""


def swept(angles: AngleDistribution, settings: PaperSettings, *, name: str = "") -> Sweep:
    """Fractions of an outline's perimeter or of a sphere over the resolution, in closed form."""
    return sweep(
        angles,
        friction=settings.friction,
        sensor_resolution=settings.swept,
        name=angles.name if isinstance(angles, Outline) else name,
        mode="scan",
    )
