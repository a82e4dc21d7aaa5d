"""Scan of a surface: all fingers but one are fixed (Wan & Howe 2018, Sec. III-B)."""

import math

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.search.pair_angles import scan
from grasp3d.arrays import ArrayLike, Floats, used_indices
from grasp3d.errors import SettingError
from grasp3d.mesh import MeshSource, load_mesh
from grasp3d.mesh.surface_points import SurfacePoints, nearest_surface_points
from grasp3d.settings import GivenModel, GraspModel, with_fingers
from grasp3d.surface.contacts import SurfaceContacts, grasps_at
from grasp3d.surface.critical_angles import SAME_POINT, critical_angles
from grasp3d.surface.grasp_numbers import BEFORE_ENUMERATION, check_combinations_of
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason, SearchReport
from grasp3d.system.context import within


def scan_surface(mesh: MeshSource, model: GivenModel = None, *, fixed: ArrayLike) -> SurfaceLabels:
    """Fix all fingers but one and label every vertex as the contact point of the last finger.

    Wan & Howe 2018, Sec. III-B, fix one finger of two. Here the grasp is given, so a U is a proof
    as well, except at the position of a fixed finger (`Reason.SAME_POINT`). Grasps of two fingers
    may be external or internal.

    Args:
        mesh: The object: an `ObjectMesh`, or whatever `load_mesh` takes (a path, a mesh of trimesh,
            PyVista or Open3D, or a pair of arrays), which is then prepared with default options.
        model: Friction and sensor resolution [rad]; the number of fingers, unless it is the default
            2, must be one more than are fixed.
        fixed: Positions of the fixed fingers in the mesh's frame, shape (3,) or (k, 3),
            moved to the nearest surface points.

    Returns:
        Labels in mode 'scan', with arrays as in `label_surface`; `partners` are the fixed fingers.

    Raises:
        MeshError: It is no mesh.
        SettingError: `fixed` are not finite points, or there are too many of them or of extreme
            normals.

    Example:
        One finger in the middle of a box's top; the vertices opposite to it are surely stable:

        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> scan = grasp3d.scan_surface(mesh, fixed=(0.0, 0.0, 0.015))
        >>> {name: round(fraction, 2) for name, fraction in scan.fractions().items()}
        {'S': 0.01, 'M': 0.08, 'U': 0.91}
        >>> mesh.vertices[scan.label == grasp3d.Label.S, 2].tolist()
        [-0.015]
    """
    mesh, points = load_mesh(mesh), _fixed_points(fixed)
    own_model = GraspModel.given("model", model) or GraspModel()
    own_model = with_fingers(own_model, len(points) + 1)
    mesh.check_units(own_model)
    if own_model.method == "extremes":
        check_combinations_of(own_model)
    count = len(mesh.vertices)
    nearest, on_surface, _ = nearest_surface_points(mesh, points)
    positions = (on_surface - mesh.center) / mesh.size  # normalised frame
    faces, weights = nearest.faces[None], nearest.weights[None]
    fixed_contacts = SurfaceContacts(mesh, SurfacePoints(faces, weights))  # one grasp
    searched = BEFORE_ENUMERATION if own_model.method == "extremes" and len(points) > 1 else 0.0
    if len(points) == 1:
        angles, grip = _scan_pairs(fixed_contacts, positions[0])
        if own_model.location_error > 0.0:
            angles = _scan_given(fixed_contacts, positions, own_model.location_error)
    else:
        with within(0.0, searched or 1.0):
            angles = _scan_given(fixed_contacts, positions, own_model.location_error)
        grip = np.zeros(count, dtype=np.int8)
    # No finger fits where another one is, whatever their normals.
    angles[1, np.isinf(angles[0])] = math.inf
    labels = SurfaceLabels.of_vertices(
        mesh,
        own_model,
        angles=(angles[0], angles[1]),
        partner_points=SurfacePoints(np.tile(faces, (count, 1)), np.tile(weights, (count, 1, 1))),
        grip=grip,
        reason=np.where(np.isinf(angles[0, mesh.canonical]), Reason.SAME_POINT, Reason.FOUND),
        sampling=None,
        mode="scan",
        search=SearchReport(cone=math.pi),
    )
    with within(searched, 1.0):
        labels.compute_labels()
    return labels


def _fixed_points(fixed: ArrayLike) -> Floats:
    """Check the positions of fixed fingers; shape (k, 3)."""
    try:
        points = np.atleast_2d(np.asarray(fixed, dtype=np.float64))
    except (TypeError, ValueError):
        points = np.zeros((0, 3))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        points = np.full((1, 3), math.nan)
    if not np.isfinite(points).all():
        raise SettingError(
            f"fixed must be one point or more, each of three finite numbers; got {fixed!r}"
        )
    return points


def _scan_pairs(fixed: SurfaceContacts, position: Floats) -> tuple[Floats, npt.NDArray[np.int8]]:
    """Angles (2, V) and grips (V,) of every vertex with one fixed finger."""
    mesh = fixed.mesh
    normals = fixed.sets.normals[:0] if (fixed.sets.counts == 0).any() else fixed.sets.normals
    angles = np.empty((2, len(mesh.vertices)))
    grip = np.empty(len(mesh.vertices), dtype=np.int8)
    scan(position, normals, mesh.normalized, mesh.contact_normals, angles[0], angles[1], grip)
    return angles, grip


def _scan_given(fixed: SurfaceContacts, positions: Floats, location_error: float) -> Floats:
    """Angles (2, V) of the grasps that every vertex makes with the fixed fingers."""
    mesh = fixed.mesh
    vertices = used_indices(mesh.faces)
    distances = np.linalg.norm(mesh.normalized[vertices, None] - positions, axis=2).min(axis=1)
    vertices = vertices[distances > SAME_POINT]
    others = np.broadcast_to(fixed.surface_points.faces, (len(mesh.vertices), len(positions)))
    weights = np.broadcast_to(fixed.surface_points.weights, (*others.shape, 3))
    grasps = grasps_at(mesh, SurfacePoints(others, weights), vertices)
    angles = np.full((2, len(mesh.vertices)), math.inf)
    angles[:, vertices] = critical_angles(grasps, location_error=location_error)
    return angles
