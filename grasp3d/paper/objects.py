"""The same in space: sphere, box, cylinder and a real object, one finger fixed, one scanned.

Wan & Howe 2018 announce these counterparts of their Fig. 7 to 10.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.mesh.primitives import box_mesh, cylinder_mesh, sphere_mesh
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.plots.painting import painted
from grasp3d.plots.style import Drawing
from grasp3d.plots.surfaces import fixed_fingers, surface_figure
from grasp3d.rendering import View
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.scanning import scan_surface
from grasp3d.sweeps import Sweep, sweep
from grasp3d.system.progress import Progress

BELOW = (0.0, 0.0, -1.0)
"""Where the first finger stands on the solids: in the middle underneath, as on the square."""

ELEVATION, ASIDE = 22.0 * DEGREE, 110.0 * DEGREE
"""From where pictures are taken: above, and the fixed finger a little behind the side."""
FROM_BELOW = View(azimuth=38.0 * DEGREE, elevation=ELEVATION)
UPRIGHT = 0.8
"""Sine of the angle above the horizontal from which on a finger stands under or on the object."""

PIXELS = (720, 720)

PICTURE_EDGE = 1.0 / 100.0
"""Longest edge of a real object's mesh, as a share of its size."""
AS_GOOD = 2e-3
"""Critical angles that differ by less count as equally good [rad]."""

TRIED = 24
"""Equally good places of which the one with most room is taken."""


@dataclass(frozen=True, eq=False)
class ScannedObject:
    """An object with one finger fixed, labelled at each resolution."""

    name: str
    scans: tuple[SurfaceLabels, ...]
    view: View
    closed_form: AngleDistribution | None = None

    def sweep(self, settings: PaperSettings) -> Sweep:
        """Shares of its area over the resolution."""
        return _swept(self.scans[0].angle_distribution(), self.name, settings)


def solids(settings: PaperSettings) -> Iterator[ScannedObject]:
    """Scan the sphere, the box and the cylinder, one after another."""
    yield _scanned("sphere", sphere_mesh(), BELOW, settings, FROM_BELOW, SphereAngles())
    yield _scanned("box", box_mesh(), BELOW, settings, FROM_BELOW)
    yield _scanned("cylinder", cylinder_mesh(), BELOW, settings, FROM_BELOW)


def load_object(path: Path) -> ObjectMesh:
    """Read a mesh finely enough for a picture.

    Raises:
        MeshError: The file is no surface.
    """
    return load_mesh(path, max_edge=PICTURE_EDGE * load_mesh(path).size)


def real_object(
    mesh: ObjectMesh,
    name: str,
    settings: PaperSettings,
    *,
    fixed: npt.ArrayLike | None = None,
    progress: Progress | None = None,
) -> ScannedObject:
    """Scan any object.

    Args:
        mesh: Its surface.
        name: What to call it.
        settings: Friction and resolutions.
        fixed: Place of the first finger, in the mesh's frame; None: where a two-finger grasp is
            best.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        SettingError: No grasp was found on it and no place is given, or that is no point.
    """
    place = best_place(mesh, settings.models[0], progress) if fixed is None else fixed
    (finger,) = fixed_fingers(scan_surface(mesh, settings.models[0], fixed=place))
    return _scanned(name, mesh, place, settings, view_of(finger.push))


def best_place(
    mesh: ObjectMesh, model: GraspModel, progress: Progress | None = None
) -> Floats:  # fmt: skip
    """Find the vertex whose best two-finger grasp bears the coarsest sensor, shape (3,).

    Many bear equally coarse ones; of some of those it is the one that leaves the second finger most
    room: the largest share S of the surface.

    Raises:
        SettingError: There is no grasp.
    """
    fine = replace(model, sensor_resolution=0.0)  # needs the narrowest search
    labels = label_surface(mesh, fine, progress=progress)
    lowest = float(labels.critical_angle.min())
    if math.isinf(lowest):
        raise SettingError(
            f"{mesh.report.source}: no grasp was found to take a place from; name one with --fixed"
        )
    good = np.flatnonzero(labels.critical_angle <= max(lowest, 0.0) + AS_GOOD)
    tried = np.unique(good[np.linspace(0, len(good) - 1, TRIED).astype(np.int64)])
    room = [
        scan_surface(mesh, model, fixed=mesh.vertices[vertex]).fractions()["S"] for vertex in tried
    ]
    return np.array(mesh.vertices[tried[int(np.argmax(room))]])


def view_of(push: Floats) -> View:
    """Look at an object so that the finger comes from the side and its partner is seen.

    Args:
        push: Inward normal at the finger, shape (3,).
    """
    outward = -push
    if abs(outward[2]) > UPRIGHT:
        above = math.copysign(ELEVATION, -outward[2])
        return View(FROM_BELOW.azimuth, above)
    return View(math.atan2(outward[1], outward[0]) + ASIDE, ELEVATION)


def object_figure(scanned: ScannedObject, settings: PaperSettings, *, pictures: bool) -> Drawing:
    """Draw the painted surface at each resolution beside the shares over all.

    Args:
        scanned: The object.
        settings: Friction and resolutions.
        pictures: Whether pictures can be drawn; else the shares alone.
    """
    images = [
        painted(scan, view=scanned.view, size=PIXELS, fingers=fixed_fingers(scan))
        for scan in scanned.scans
        if pictures
    ]
    exact = scanned.closed_form
    return surface_figure(
        scanned.scans,
        images,
        scanned.sweep(settings),
        closed_form=None if exact is None else _swept(exact, scanned.name, settings),
    )


def _scanned(
    name: str,
    mesh: ObjectMesh,
    fixed: npt.ArrayLike,
    settings: PaperSettings,
    view: View,
    closed_form: AngleDistribution | None = None,
) -> ScannedObject:
    first, *others = settings.models
    scan = scan_surface(mesh, first, fixed=fixed)
    scans = [scan.relabel(sensor_resolution=model.sensor_resolution) for model in others]
    return ScannedObject(name, (scan, *scans), view, closed_form)


def _swept(angles: AngleDistribution, name: str, settings: PaperSettings) -> Sweep:
    return sweep(
        angles,
        friction=settings.friction,
        sensor_resolution=settings.swept,
        name=name,
        mode="scan",
    )
