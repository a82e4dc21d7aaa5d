"""Figures 4 to 11 of Wan & Howe 2018, and two beside them, one function each.

The two are fractions over the uncertainties that the paper names but works out no more (Sec. III-A
and IV-B): friction, contact location and joint encoders. Beside them are fractions of random true
grasps, an independent check of the closed form: contacts, normals and frictions are drawn within
their bounds, and each true grasp is decided by the definition alone. The scans in space are those
of sphere, box, cylinder and a real object, one finger fixed, one scanned, which the paper announces
as counterparts of its Fig. 7 to 10.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Floats
from grasp3d.contact.sensor import Sensor
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.mesh.primitives import box_mesh, cylinder_mesh, sphere_mesh
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.planar import Circle, scan, square
from grasp3d.plots.cones import combinations_figure, cone_figure, tips_figure
from grasp3d.plots.curves import curves_figure
from grasp3d.plots.figures import Drawing
from grasp3d.plots.fractions import (
    ErrorPanel,
    ceiling_figure,
    error_fractions_figure,
    fixed_fingers,
    fractions_figure,
    surface_figure,
)
from grasp3d.plots.heat_maps import heat_map_figure
from grasp3d.plots.painting import paint_labels
from grasp3d.plots.rendering import View
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.scanning import scan_surface
from grasp3d.surface.sweeps import Sweep, sweep
from grasp3d.system.context import unreported

BELOW = (0.0, 0.0, -1.0)
"""Contact point of the first finger on the solids: in the middle underneath, as on the square."""

ELEVATION, ASIDE = 22.0 * DEGREE, 110.0 * DEGREE
"""Camera elevation, and its azimuth from the fixed finger, which is then a little behind the side.
"""
FROM_BELOW = View(azimuth=38.0 * DEGREE, elevation=ELEVATION)
UPRIGHT = 0.8
"""Sine of the elevation of a finger from which it counts as under or on top of the object."""

PIXELS = (720, 720)

PICTURE_EDGE = 1.0 / 100.0
"""Longest edge of a real object's mesh, as a fraction of its size."""
AS_GOOD = 2e-3
"""Critical angles that differ by less count as equally good [rad]."""

COMPARED = 24
"""Equally good contact points that are compared by the area fraction S of their scan."""


@dataclass(frozen=True, eq=False)
class ScannedObject:
    """An object with one finger fixed, labelled at each resolution."""

    name: str
    scans: tuple[SurfaceLabels, ...]
    view: View
    closed_form: AngleDistribution | None = None
    length: float = 1.0
    """Radius or half a side of a solid, half the size of a real object [mesh unit]."""

    def angles_at(self, location: float) -> AngleDistribution:
        """Critical angles at a location error, as a fraction of `length`."""
        return self.scans[0].angle_distribution(location_error=location * self.length)

    def sweep(self, settings: PaperSettings) -> Sweep:
        """Area fractions over the resolution."""
        return swept(self.scans[0].angle_distribution(), self.name, settings)


def solids(settings: PaperSettings) -> Iterator[ScannedObject]:
    """Scan the sphere, the box and the cylinder, one after another."""
    yield _scanned("sphere", sphere_mesh(), BELOW, settings, FROM_BELOW, SphereAngles())
    yield _scanned("box", box_mesh(), BELOW, settings, FROM_BELOW)
    yield _scanned("cylinder", cylinder_mesh(), BELOW, settings, FROM_BELOW)


def load_object(path: Path) -> ObjectMesh:
    """Read a mesh finely enough for a picture.

    Raises:
        MeshError: The file contains no surface.
    """
    return load_mesh(path, max_edge=PICTURE_EDGE * load_mesh(path).size)


def real_object(
    mesh: ObjectMesh, name: str, settings: PaperSettings, *, fixed: ArrayLike | None = None
) -> ScannedObject:
    """Scan any object.

    Args:
        mesh: Its surface.
        name: Its name.
        settings: Friction and resolutions.
        fixed: Contact point of the first finger, in the mesh's frame; None: where a two-finger
            grasp is best.

    Raises:
        SettingError: No grasp was found on it and no point is given, or `fixed` is not a point.
    """
    point = best_contact_point(mesh, settings.models[0]) if fixed is None else fixed
    with unreported():
        (finger,) = fixed_fingers(scan_surface(mesh, settings.models[0], fixed=point))
        scanned = _scanned(name, mesh, point, settings, view_of(finger.normal))
    return replace(scanned, length=mesh.size / 2.0)


def best_contact_point(mesh: ObjectMesh, model: GraspModel) -> Floats:
    """Find the vertex whose best two-finger grasp tolerates the coarsest sensor, shape (3,).

    Several vertices may tolerate equally coarse sensors; of some of these it is the vertex with
    the largest area fraction S for the second finger.

    Raises:
        SettingError: There is no grasp.
    """
    fine = replace(model, sensor_resolution=0.0)  # smallest search cone
    labels = label_surface(mesh, fine)
    lowest = float(labels.critical_angle.min())
    if math.isinf(lowest):
        raise SettingError(
            f"{mesh.report.source}: no grasp was found that gives the fixed finger's contact "
            "point; set one with --fixed"
        )
    good = np.flatnonzero(labels.critical_angle <= max(lowest, 0.0) + AS_GOOD)
    compared = np.unique(good[np.linspace(0, len(good) - 1, COMPARED).astype(np.int64)])
    with unreported():
        stable = [
            scan_surface(mesh, model, fixed=mesh.vertices[vertex]).fractions()["S"]
            for vertex in compared
        ]
    return np.array(mesh.vertices[compared[int(np.argmax(stable))]])


def view_of(normal: Floats) -> View:
    """View in which the finger is at the side and the opposing contact is visible.

    Args:
        normal: Inward normal at the finger, shape (3,).
    """
    outward = -normal
    if abs(outward[2]) > UPRIGHT:
        above = math.copysign(ELEVATION, -outward[2])
        return View(FROM_BELOW.azimuth, above)
    return View(math.atan2(outward[1], outward[0]) + ASIDE, ELEVATION)


def object_figure(scanned: ScannedObject, settings: PaperSettings, *, pictures: bool) -> Drawing:
    """Draw the labelled surface at each resolution, and the area fractions over all resolutions.

    Args:
        scanned: The object.
        settings: Friction and resolutions.
        pictures: Whether pictures can be rendered; otherwise only the fractions are drawn.
    """
    images = [
        paint_labels(scan, view=scanned.view, size=PIXELS, fingers=fixed_fingers(scan))
        for scan in scanned.scans
        if pictures
    ]
    exact = scanned.closed_form
    return surface_figure(
        scanned.scans,
        images,
        scanned.sweep(settings),
        closed_form=None if exact is None else swept(exact, scanned.name, settings),
    )


def _scanned(
    name: str,
    mesh: ObjectMesh,
    fixed: ArrayLike,
    settings: PaperSettings,
    view: View,
    closed_form: AngleDistribution | None = None,
) -> ScannedObject:
    first, *others = settings.models
    scan = scan_surface(mesh, first, fixed=fixed)
    scans = [scan.relabel(sensor_resolution=model.sensor_resolution) for model in others]
    return ScannedObject(name, (scan, *scans), view, closed_form)


def swept(angles: AngleDistribution, name: str, settings: PaperSettings) -> Sweep:
    """Fractions over the resolution, in closed form or of a scan.

    Args:
        angles: An outline, a sphere, or the critical angles of a scan.
        name: Its name.
        settings: Friction and resolutions.
    """
    return sweep(
        angles,
        friction=settings.friction,
        sensor_resolution=settings.swept,
        name=name,
        mode="scan",
    )


CONE_MODEL = GraspModel(friction=1.0, sensor_resolution=30.0 * DEGREE)
"""Model of the drawings of cones for all settings: all its angles are clearly visible."""

TIP = Sensor(receptive_field=4.0, fingertip_radius=10.0)
"""The paper's hemispherical tip, with the receptive field that it needs at friction 0.2 [mm]."""

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

GRASPS = 360
"""Perceived grasps, evenly around the circle."""
TRUE = 400
"""True grasps of each perceived one."""
EXTREME = 0.7
"""Fraction of the errors that are as large as possible."""
SEED = 2018


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
    return fractions_figure(swept(Circle(), "circle", settings))


def square_curves(settings: PaperSettings) -> Drawing:
    """Draw Fig. 9: epsilon along the square."""
    scans = [scan(square(), model) for model in settings.models]
    return curves_figure(scans, over="position", unit="half sides")


def square_fractions(settings: PaperSettings) -> Drawing:
    """Draw Fig. 10: fractions of the square over the resolution."""
    return fractions_figure(swept(square(), "square", settings))


def ceilings(settings: PaperSettings) -> Drawing:
    """Draw Fig. 11: the best possible accuracy of a learned predictor.

    The paper's curve is that of the sphere, by area; those of circle and square, by perimeter, are
    for comparison.
    """
    sphere = swept(SphereAngles(), "sphere (the paper's)", settings)
    outlines = [swept(outline, outline.name, settings) for outline in (Circle(), square())]
    return ceiling_figure([sphere, *outlines])


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
    fractions = sweep(
        Circle(),
        friction=model.friction,
        sensor_resolution=model.sensor_resolution,
        name="circle",
        mode="scan",
        **{name: values},
    )
    return ErrorPanel(fractions, title, _sampled(model, name, values[:: STEPS // SAMPLED]))


def _sampled(model: GraspModel, name: str, values: Floats) -> list[tuple[float, float, float]]:
    in_degrees = name == "normal_error"
    sampled = []
    for value in values.tolist():
        settings = {
            "friction": model.friction,
            "sensor_resolution": model.sensor_resolution,
            name: value,
        }
        number = math.degrees(value) if in_degrees else value
        sampled.append((number, *sampled_fractions(GraspModel(**settings))))
    return sampled


def sampled_fractions(model: GraspModel, *, true: int = TRUE) -> tuple[float, float]:
    """Fractions of perceived grasps of a circle of radius 1 that hold always, and never.

    Args:
        model: Friction and its error, tilt and location error in radii.
        true: True grasps of each.

    Returns:
        (S, U). Sampling misses some true grasps that fail or hold, so both are a little too large.
    """
    rng = np.random.default_rng(SEED)
    turn = (np.arange(GRASPS) + 0.5) * (2.0 * math.pi / GRASPS)
    angles = np.stack([np.zeros(GRASPS), turn], axis=1)
    points = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # (g, 2, 2)
    held = _held(points, angles + math.pi, model, true, rng)
    return float(held.all(axis=1).mean()), 1.0 - float(held.any(axis=1).mean())


def _held(
    points: Floats, normals: Floats, model: GraspModel, true: int, rng: np.random.Generator
) -> Bools:
    """Force closure of random true grasps, shape (g, true).

    Args:
        points: Perceived contacts, shape (g, 2, 2).
        normals: Polar angles of their normals [rad], shape (g, 2).
        model: What is known about them.
        true: True grasps of each perceived one.
        rng: Random numbers.
    """
    shape = (len(points), true, 2)
    direction = rng.uniform(0.0, 2.0 * math.pi, shape)
    radius = float(model.location_error) * np.abs(_errors(shape, rng))
    shift = radius[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    apart = np.diff(points[:, None] + shift, axis=2)[:, :, 0]  # (g, true, 2)
    line = np.arctan2(apart[..., 1], apart[..., 0])[..., None] + [0.0, math.pi]
    turn = line - normals[:, None] - model.tilt * _errors(shape, rng)
    off = np.abs(np.remainder(turn + math.pi, 2.0 * math.pi) - math.pi)
    cone = np.arctan(model.friction + model.friction_error * _errors(shape, rng))
    return np.asarray((off < cone).all(axis=-1) | (math.pi - off < cone).all(axis=-1))


def _errors(shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """Errors from -1 to 1, most of them at the ends."""
    ends = rng.choice([-1.0, 1.0], shape)
    return np.where(rng.random(shape) < EXTREME, ends, rng.uniform(-1.0, 1.0, shape))


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
