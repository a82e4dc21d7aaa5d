"""Figures 4 to 11 of Wan & Howe 2018, one function each, and their settings.

The scans in space are those of sphere, box, cylinder and a real object, one finger fixed, one
scanned, which the paper announces as counterparts of its Fig. 7 to 10.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from matplotlib.figure import Figure

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.contact.sensor import Sensor
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.paper.cones import combinations_figure, cone_figure, tips_figure
from grasp3d.paper.curves import ceiling_figure, curves_figure, fractions_figure
from grasp3d.pictures.camera import View
from grasp3d.planar import Circle, Outline, PlanarScan, Square, scan
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.scanning import scan_surface
from grasp3d.surface.sweeps import Sweep, sweep
from grasp3d.system.context import unreported

WIDEST = 120.0 * DEGREE
"""Largest resolution of the swept fractions [rad]."""
STEPS = 480
"""Steps of the swept resolutions: a quarter of a degree each."""
COLUMNS = 2
"""Most resolutions that fit side by side on a page."""

BELOW = (0.0, 0.0, -1.0)
"""Contact point of the first finger on the solids: in the middle underneath, as on the square."""

ELEVATION, ASIDE = 22.0 * DEGREE, 110.0 * DEGREE
"""Camera elevation, and its azimuth from the fixed finger, which is then a little behind the side.
"""
UPRIGHT, AZIMUTH = 0.8, 38.0 * DEGREE
"""Sine of the elevation of a finger from which it counts as under or on top of the object, and the
camera's azimuth then."""

PIXELS = (720, 720)

PICTURE_EDGE = 1.0 / 100.0
"""Longest edge of a real object's mesh, as a fraction of its size."""
AS_GOOD = 2e-3
"""Critical angles that differ by less count as equally good [rad]."""

COMPARED = 24
"""Equally good contact points that are compared by the area fraction S of their scan."""


@dataclass(frozen=True)
class PaperSettings:
    """Friction, and the resolutions at which curves and pictures are drawn.

    Attributes:
        friction: Coulomb coefficient, above 0.
        sensor_resolutions: Resolutions alpha [rad], one or two, each with a column of the figures.
    """

    friction: float = 1.0
    sensor_resolutions: tuple[float, ...] = (30.0 * DEGREE, 15.0 * DEGREE)

    def __post_init__(self) -> None:
        if not 1 <= len(self.sensor_resolutions) <= COLUMNS:
            raise SettingError(
                f"give one or two sensor resolutions; got {len(self.sensor_resolutions)}"
            )
        if len(set(self.sensor_resolutions)) < len(self.sensor_resolutions):
            degrees = ", ".join(f"{math.degrees(angle):g}" for angle in self.sensor_resolutions)
            raise SettingError(f"sensor resolutions must be different; got {degrees}")
        _ = self.models

    @property
    def models(self) -> tuple[GraspModel, ...]:
        """Models of the one friction at each resolution."""
        return tuple(
            GraspModel(friction=self.friction, sensor_resolution=angle)
            for angle in self.sensor_resolutions
        )

    @property
    def swept(self) -> Floats:
        """Resolutions over which fractions are drawn [rad], shape (k,)."""
        return np.linspace(0.0, WIDEST, STEPS + 1)


@dataclass(frozen=True, eq=False)
class ScannedObject:
    """An object with one finger fixed, labelled at each resolution."""

    name: str
    scans: tuple[SurfaceLabels, ...]
    closed_form: AngleDistribution | None = None


def solids(settings: PaperSettings) -> Iterator[ScannedObject]:
    """Scan the sphere, the box and the cylinder, one after another."""
    sphere = load_mesh(trimesh.creation.icosphere(5), max_edge=4.0)
    box = load_mesh(trimesh.creation.box((2.0, 2.0, 2.0)), max_edge=2.0 / 64.0)
    yield _scanned("sphere", sphere, BELOW, settings, closed_form=SphereAngles())
    yield _scanned("box", box, BELOW, settings)
    yield _scanned("cylinder", _cylinder(), BELOW, settings)


def _cylinder() -> ObjectMesh:
    """A cylinder about x of radius 1 and length 3, without slivers; its sides are 2.5 degrees."""
    across = np.linspace(0.0, 1.0, 21, endpoint=False)
    along = np.linspace(-1.5, 1.5, 64)
    ends = np.full_like(across, 1.5)
    radii = np.concatenate([across, np.ones_like(along), across[::-1]])
    profile = np.column_stack([radii, np.concatenate([-ends, along, ends])])
    cylinder = trimesh.creation.revolve(profile, sections=144)
    cylinder.vertices = cylinder.vertices[:, [2, 0, 1]]
    return load_mesh(cylinder, max_edge=3.0 / 64.0)


def load_object(path: Path) -> ObjectMesh:
    """Read a mesh finely enough for a picture.

    Raises:
        MeshError: The file contains no surface.
    """
    return load_mesh(path, max_edge=PICTURE_EDGE * load_mesh(path).size)


def real_object(mesh: ObjectMesh, name: str, settings: PaperSettings) -> ScannedObject:
    """Scan any object, the first finger where a two-finger grasp is best.

    Args:
        mesh: Its surface.
        name: Its name.
        settings: Friction and resolutions.

    Raises:
        SettingError: No grasp was found on it.
    """
    point = best_contact_point(mesh, settings.models[0])
    with unreported():
        return _scanned(name, mesh, point, settings)


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
            f"{mesh.report.source}: no grasp was found that gives the fixed finger's contact point"
        )
    good = np.flatnonzero(labels.critical_angle <= max(lowest, 0.0) + AS_GOOD)
    compared = np.unique(good[np.linspace(0, len(good) - 1, COMPARED).astype(np.int64)])
    with unreported():
        scans = [scan_surface(mesh, model, fixed=point) for point in mesh.vertices[compared]]
    best = int(np.argmax([one.fractions()["S"] for one in scans]))
    return np.array(mesh.vertices[compared[best]])


def view_of(normal: Floats) -> View:
    """View in which the finger is at the side and the opposing contact is visible.

    Args:
        normal: Inward normal at the finger, shape (3,).
    """
    outward = -normal
    if abs(outward[2]) > UPRIGHT:
        return View(AZIMUTH, math.copysign(ELEVATION, -outward[2]))
    return View(math.atan2(outward[1], outward[0]) + ASIDE, ELEVATION)


def object_figure(scanned: ScannedObject, settings: PaperSettings, *, pictures: bool) -> Figure:
    """Draw the labelled surface at each resolution, and the area fractions over all resolutions.

    Args:
        scanned: The object.
        settings: Friction and resolutions.
        pictures: Whether pictures can be rendered; otherwise only the fractions are drawn.
    """
    from grasp3d.pictures.stills import draw_labels

    exact, first = scanned.closed_form, scanned.scans[0].distinct[0]
    view = view_of(scanned.scans[0].partner_normals[first, 0])
    images = [
        draw_labels(scan, view=view, size=PIXELS, fixed=scan.partners[first])
        for scan in scanned.scans
        if pictures
    ]
    return fractions_figure(
        swept(scanned.scans[0].angle_distribution(), scanned.name, settings),
        "area fraction",
        scans=scanned.scans,
        pictures=images,
        closed_form=None if exact is None else swept(exact, scanned.name, settings),
    )


def _scanned(
    name: str, mesh: ObjectMesh, fixed: ArrayLike, settings: PaperSettings, **closed: Any
) -> ScannedObject:
    first, *others = settings.models
    scan = scan_surface(mesh, first, fixed=fixed)
    scans = [scan.relabel(sensor_resolution=model.sensor_resolution) for model in others]
    return ScannedObject(name, (scan, *scans), **closed)


def swept(angles: AngleDistribution, name: str, settings: PaperSettings) -> Sweep:
    """Fractions over the resolution, in closed form or of a scan.

    Args:
        angles: An outline, a sphere, or the critical angles of a scan.
        name: Its name.
        settings: Friction and resolutions.
    """
    return sweep(
        angles, friction=settings.friction, sensor_resolution=settings.swept, name=name, mode="scan"
    )


CONE_MODEL = GraspModel(friction=1.0, sensor_resolution=30.0 * DEGREE)
"""Model of the drawings of cones for all settings: all its angles are clearly visible."""

TIP = Sensor(receptive_field=4.0, fingertip_radius=10.0)
"""The paper's hemispherical tip, with the receptive field that it needs at friction 0.2 [mm]."""


FIGURES: dict[str, Callable[[PaperSettings], Figure]] = {
    "figure_04": lambda _: tips_figure(TIP),
    "figure_05": lambda _: cone_figure(CONE_MODEL),
    "figure_06": lambda _: combinations_figure(CONE_MODEL),
    "figure_07": lambda own: curves_figure(_scans(Circle(), own)),
    "figure_08": lambda own: fractions_figure(swept(Circle(), "circle", own)),
    "figure_09": lambda own: curves_figure(_scans(Square(), own)),
    "figure_10": lambda own: fractions_figure(swept(Square(), "square", own)),
    # The paper's curve is that of the sphere, by area; the others are for comparison.
    "figure_11": lambda own: ceiling_figure(
        [
            swept(SphereAngles(), "sphere (the paper's)", own),
            *(swept(outline, outline.name, own) for outline in (Circle(), Square())),
        ]
    ),
}
"""Functions that draw the figures, by the name of their files without suffix: tips, cones of one
contact and their combinations; epsilon, then fractions, of the circle and of the square; the best
accuracy of a learned predictor."""


def _scans(outline: Outline, settings: PaperSettings) -> list[PlanarScan]:
    return [scan(outline, model) for model in settings.models]
