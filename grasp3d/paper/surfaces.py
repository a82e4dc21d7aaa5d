"""Labels from wrench hulls alone against exact ones, over whole surfaces."""

import math
from dataclasses import replace

import numpy as np

from grasp3d.arrays import Bools
from grasp3d.mesh.primitives import box_mesh, cylinder_mesh, sphere_mesh
from grasp3d.paper.convergence import ALLOWED
from grasp3d.paper.markdown import fraction_cells, table
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.stability.label import Label
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.scanning import scan_surface

BELOW = (0.0, 0.0, -1.0)
"""Contact point of the first finger in scans."""
EDGE = 1.0 / 8.0
"""Longest edge of the box, whose sides are 2; twice that on the cylinder."""
SUBDIVISIONS = 4
"""Subdivisions of the sphere: 2,562 vertices."""
EDGES = (None, 8)
ROUNDED = 1e-9
"""Distance of a critical angle from a threshold that rounding errors explain [rad]."""
SEARCHED = GraspModel(friction=0.2, sensor_resolution=15.0 * DEGREE)
"""Model for searched grasps: low friction, so that not all vertices are S."""


def surface_table(settings: PaperSettings) -> str:
    """Write a table of three solids, scanned and labelled by both methods."""
    head = ("object", "grasps", "μ", "α", "cones", "S, exact", "M, exact", "U, exact", "S, hulls",
            "M, hulls", "U, hulls", "area that differs", "vertices not allowed")  # fmt: skip
    solids = {
        "sphere": sphere_mesh(subdivisions=SUBDIVISIONS),
        "box": box_mesh(max_edge=EDGE),
        "cylinder": cylinder_mesh(max_edge=2.0 * EDGE),
    }
    rows = []
    for name, mesh in solids.items():
        exact = {
            "one finger fixed": scan_surface(mesh, settings.models[0], fixed=BELOW),
            "searched": label_surface(mesh, SEARCHED),
        }
        for kind, labels in exact.items():
            rows += [[name, kind, *_compared(labels, edges)] for edges in EDGES]
    return (
        "The same grasps labelled exactly, for all normals, and from the wrench hulls of 8 extreme "
        "normals and the perceived one; at creases those of every face, and the bisecting normal. "
        "The meshes are coarser than above, so the area fractions differ a little. 'Vertices not "
        "allowed' are those whose labels differ in a way that neither an untested tilt nor a "
        "polygon inside its cone nor rounding at the threshold of U explains.\n\n"
        + table(head, rows, left=2)
    )


def _compared(exact: SurfaceLabels, edges: int | None) -> list[str]:
    """The cells of one row."""
    model = replace(exact.model, method="extremes", edges=edges)
    hulls = replace(exact, model=model)
    areas = exact.mesh.vertex_areas
    differ = float(areas[exact.label != hulls.label].sum() / areas.sum())
    wrong = (exact.label != hulls.label) & ~_left_open(exact, hulls)
    for pair in ALLOWED["circular" if edges is None else "polygonal"]:
        wrong &= (exact.label != pair[0]) | (hulls.label != pair[1])
    return [
        f"{model.friction:g}",
        f"{math.degrees(model.sensor_resolution):.4g}°",
        "circular" if edges is None else f"{edges} edges",
        *fraction_cells(exact.fractions()),
        *fraction_cells(hulls.fractions()),
        f"{100.0 * differ:.2f} %",
        str(int(np.count_nonzero(wrong))),
    ]


def _left_open(exact: SurfaceLabels, hulls: SurfaceLabels) -> Bools:
    """Whether a grasp at the threshold of U is U exactly, and rounding leaves its hulls open, (V,).

    What rounding leaves open is M.
    """
    threshold = exact.model.friction_angle + exact.model.tilt
    near = np.abs(exact.critical_angle_best - threshold) < ROUNDED
    tied: Bools = near & (exact.label == Label.U) & (hulls.label == Label.M)
    return tied
