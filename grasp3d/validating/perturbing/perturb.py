"""Labelling of noisy copies of a scan: what noise does to its normals, points and grasps."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.surface.surface_contacts import smallest_angle
from grasp3d.arrays import Bools, Bytes, Floats, Ints, angles_between, locked
from grasp3d.errors import SettingError
from grasp3d.mesh import MeshSource
from grasp3d.mesh.noise import noise_stream, random_field
from grasp3d.mesh.noisy_copies import MovableSurface, movable_surface, noise_length
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import AnySampling, GraspModel, MeshOptions
from grasp3d.stability.label import Label
from grasp3d.surface.area_statistics import quantiles, vertex_weights
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.context import begin_step, report_progress, unreported
from grasp3d.validating.perturbing.noise_settings import NoiseSettings
from grasp3d.validating.perturbing.perturbation import Perturbation, advise

MOST_NOISE = 0.1
"""Largest noise, in object sizes: more leaves nothing of the shape."""

Singles = npt.NDArray[np.float32]

COPIES = 2
"""Number of the streams of random numbers of copies."""


class CopyResult(NamedTuple):
    """What one noisy copy of a surface shows; arrays over the vertices, (V,).

    Numbers have 32 bits, as those of all copies are in memory together.
    """

    label: Bytes
    """Labels of the copy, of the best grasps found there."""
    critical_angle: Singles
    """Their critical friction angles [rad]; inf: no grasp."""
    kept: Bools
    """Whether the surface's own best grasp is S in the copy."""
    stable_area: float
    """Area that is S in the copy, by the areas of the surface itself."""
    right_area: float
    """Area of that part whose grasp is S on the surface itself."""
    turn: Singles
    """Largest angle between the copy's normals and the surface's normal, or set of normals, at the
    vertex [rad]."""
    shift: Singles
    """How far the vertex moved, in the mesh's unit."""
    across: Singles
    """How far the contacts of the surface's own grasp moved across the line between them, as the
    mean of the two: two fingers; for more, how far the vertex moved. nan: no grasp."""


def noisy_copies(
    surface: MovableSurface, sigma: float, correlation: float, seed: int, count: int
) -> Iterator[ObjectMesh]:
    """Make copies of a surface whose vertices are moved along their normals at random.

    Every copy has a random stream of its own, so that copy k is the same for any number of them.

    Args:
        surface: The surface.
        sigma: Standard deviation of the displacements, in the mesh's unit.
        correlation: Correlation length, in the mesh's unit; see `random_field`.
        seed: Seed of all copies.
        count: Number of copies.
    """
    for number in range(count):
        random = noise_stream(seed, COPIES, number)
        field = random_field(surface.points, surface.normals, correlation, random)
        yield surface.moved(sigma * field[:, None] * surface.normals)


def examine_copy(labels: SurfaceLabels, copy: ObjectMesh) -> CopyResult:
    """Label a copy of a surface, and compare it with the surface.

    Args:
        labels: The labels of the surface itself.
        copy: A copy, with the same faces.
    """
    result = label_surface(copy, labels.model, sampling=labels.sampling)
    shift = np.linalg.norm(copy.vertices - labels.mesh.vertices, axis=1)
    across = _shift_across(labels, copy) if labels.model.fingers == 2 else shift
    areas, limit = labels.mesh.vertex_areas, labels.model.effective_friction_angle
    stable = result.label == Label.S
    right = stable & (angles_on(labels.mesh, result) < limit)
    return CopyResult(
        label=result.label,
        critical_angle=result.critical_angle.astype(np.float32),
        kept=angles_on(copy, labels) < limit,
        stable_area=float(areas[stable].sum()),
        right_area=float(areas[right].sum()),
        turn=turned_normals(labels.mesh, copy).astype(np.float32),
        shift=shift.astype(np.float32),
        across=across.astype(np.float32),
    )


def angles_on(mesh: ObjectMesh, labels: SurfaceLabels) -> Floats:
    """Critical friction angles of labelled grasps on another copy of their surface [rad], (V,).

    The contacts are at the same surface points: face and barycentric coordinates.

    Args:
        mesh: A mesh of the same faces.
        labels: Labels with a grasp for each vertex, or none: inf.
    """
    rows = np.flatnonzero(labels.reason == Reason.FOUND)
    angles = np.full(len(labels.row), math.inf)
    if len(rows):
        contacts = SurfaceContacts(mesh, _surface_points(labels, rows))
        angles[rows], _ = critical_angles(contacts)
    return angles


def turned_normals(mesh: ObjectMesh, copy: ObjectMesh) -> Floats:
    """Largest angle from a surface's normals to those of its copy at each vertex [rad], (V,).

    At creases it is the distance from the set of the surface's normals.
    """
    sets, corners = mesh.normal_sets, copy.corner_normals
    vertex, normals = corners.vertices, corners.normals
    single = sets.counts[vertex] == 1
    angles = np.zeros(len(vertex))
    angles[single] = angles_between(normals[single], sets.normals[sets.start[vertex[single]]])
    for row in np.flatnonzero(~single & (sets.counts[vertex] > 0)):
        at = vertex[row]
        angles[row] = smallest_angle(sets.normals, sets.start[at], sets.counts[at], *normals[row])
    largest = np.zeros(len(mesh.vertices))
    np.maximum.at(largest, vertex, angles)
    return np.asarray(largest[mesh.canonical])


def _shift_across(labels: SurfaceLabels, copy: ObjectMesh) -> Floats:
    """Half the distance by which two contacts moved relative to each other across their line.

    It is the location error whose bound for the turn of the line, asin(2 error / opening), is the
    turn that was seen.
    """
    rows = np.flatnonzero(labels.reason == Reason.FOUND)
    points = _surface_points(labels, rows)
    lines = [np.diff(points.positions(mesh), axis=1)[:, 0] for mesh in (labels.mesh, copy)]
    turn = np.minimum(angles_between(*lines), math.pi / 2.0)
    across = np.full(len(labels.row), math.nan)
    across[rows] = 0.5 * np.linalg.norm(lines[0], axis=1) * np.sin(turn)
    return across


def _surface_points(labels: SurfaceLabels, rows: Ints | Bools) -> SurfacePoints:
    """All contacts of the grasps of some vertices, (b, n)."""
    own, others = vertex_surface_points(labels.mesh, rows), labels.partner_points
    return SurfacePoints(
        np.concatenate([own.faces[:, None], others.faces[rows, 0]], axis=1),
        np.concatenate([own.weights[:, None], others.weights[rows, 0]], axis=1),
    )


def perturb_surface(
    mesh: MeshSource | MovableSurface,
    model: GraspModel | None = None,
    *,
    noise: NoiseSettings | None = None,
    sampling: AnySampling | None = None,
    options: MeshOptions | None = None,
) -> Perturbation:
    """Label noisy copies of a scan, and find the errors to enter for it.

    The vertices of each copy are moved along their normals at random; along the surface an error
    would not change its shape. Vertices that divide long edges move with their faces. A copy is
    searched again for the best grasp at each vertex.

    Args:
        mesh: The scan: a path or an object, as in `load_mesh`, or a surface that is prepared.
        model: Friction, sensor resolution and normal error without noise; None: the defaults.
        noise: Noise of the copies, and their number; None: the defaults.
        sampling: How grasps are searched for; None: the defaults.
        options: How the mesh is read and prepared; None: those of an `ObjectMesh`, or the defaults.

    Returns:
        For each vertex the fractions of the copies that are S, M and U, the spread of the critical
        friction angle, and how far normals turn and points move; and the errors to enter.

    Raises:
        SettingError: A setting is outside its range, a length has a unit but the mesh has none, or
            the model has another method than exact, a location error, or differing fingers.
        MeshError: It is no mesh, or no noise is given and none can be measured.

    Example:
        A ball with errors of 0.5 % of its radius, of which 8 copies are made:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.validating.perturbing import NoiseSettings, perturb_surface
        >>> ball = trimesh.creation.icosphere(3)
        >>> errors = np.random.default_rng(0).normal(0.0, 0.005, len(ball.vertices))
        >>> scan = ball.vertices * (1.0 + errors)[:, None], ball.faces
        >>> noise, options = NoiseSettings(noise=0.005, copies=8), grasp3d.MeshOptions(max_edge=9.0)
        >>> result = perturb_surface(scan, noise=noise, options=options)
        >>> result.stable.shape, bool(result.advice.unconfirmed_fraction <= 0.01)
        ((642,), True)
    """
    surface = mesh if isinstance(mesh, MovableSurface) else movable_surface(mesh, options)
    settings, own_model = surface.mesh.in_own_unit(noise or NoiseSettings(), model or GraspModel())
    if own_model.method != "exact":
        raise SettingError("noisy copies need the method exact; method extremes has no margins")
    if not own_model.is_uniform:
        raise SettingError(
            "noisy copies are labelled without location_error and per_finger: leave them out here, "
            "and add them to the errors of the result"
        )
    begin_step("estimating the noise")
    sigma = _sigma(surface, settings)
    with unreported():
        labels = label_surface(surface.mesh, own_model, sampling=sampling)
    begin_step("labelling noisy copies")
    results = []
    for copy in noisy_copies(
        surface, sigma, settings.correlation, settings.noise_seed, settings.copies
    ):
        with unreported():
            results.append(examine_copy(labels, copy))
        report_progress(len(results) / (settings.copies + 1))
    with unreported():
        perturbation = _gathered(
            labels, results, replace(settings, noise=sigma), estimated=settings.noise is None
        )
    report_progress(1.0)
    return perturbation


def _sigma(surface: MovableSurface, settings: NoiseSettings) -> float:
    size, lengths = surface.mesh.size, settings.lengths()
    for name, part in (("noise", MOST_NOISE), ("correlation", 1.0)):
        if (lengths[name] or 0.0) > part * size:
            raise SettingError(
                f"{name} is {lengths[name]:.4g}, but the size of {surface.mesh.report.source} is "
                f"{size:.4g}; give at most {part * size:.4g}, or a unit (0.5mm)"
            )
    if settings.noise is not None:
        return settings.noise
    return noise_length(surface, settings.correlation, seed=settings.noise_seed)


def _gathered(
    labels: SurfaceLabels, results: list[CopyResult], settings: NoiseSettings, *, estimated: bool
) -> Perturbation:
    """Fractions and quantiles over the copies."""
    level = settings.level
    columns = (np.stack(column) for column in zip(*results, strict=True))
    codes, angles, kept, stable_areas, right_areas, turns, shifts, acrosses = columns  # (N, V), (N)
    stable, right = sum(stable_areas.tolist()), sum(right_areas.tolist())
    across = _quantile(labels, acrosses, level)
    confirmed: Bools = (codes == Label.S).sum(axis=0) >= math.ceil(level * len(codes) - 1e-9)
    parts = {label: locked((codes == label).mean(axis=0)) for label in Label}
    return Perturbation(
        labels=labels,
        settings=settings,
        estimated=estimated,
        stable=parts[Label.S],
        ambiguous=parts[Label.M],
        unstable=parts[Label.U],
        kept=locked(np.where(np.isinf(labels.critical_angle), math.nan, kept.mean(axis=0))),
        critical_angle_low=_over_copies(angles, 1.0 - level),
        critical_angle_high=_over_copies(angles, level),
        normal_turn=_over_copies(turns, level),
        shift=_over_copies(shifts, level),
        shift_across=across,
        confirmed_fraction=right / stable if stable else math.nan,
        advice=advise(labels, confirmed, _quantile(labels, turns, level), across),
    )


def _over_copies(values: Singles, level: float) -> Floats:
    """Quantile of each vertex over the copies (N, V): a value that so many do not exceed."""
    return locked(np.quantile(values, level, axis=0, method="inverted_cdf"), np.float64)


def _quantile(labels: SurfaceLabels, values: Singles, level: float) -> float:
    """Quantile over area and copies of values (N, V); nan does not count."""
    weights = np.where(np.isnan(values), 0.0, vertex_weights(labels.mesh, "area"))
    if not weights.any():
        return 0.0
    return float(
        quantiles(np.nan_to_num(values).ravel().astype(np.float64), [level], weights.ravel())[0]
    )
