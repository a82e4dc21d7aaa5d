"""Labels of noisy copies of a scan: what noise does to its grasps, and the errors to enter."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.surface.surface_contacts import smallest_angle
from grasp3d.arrays import Bools, Bytes, Floats, Ints, angles_between, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.mesh import MeshSource
from grasp3d.mesh.noise import noise_stream, random_field
from grasp3d.mesh.noisy_copies import MovableSurface, movable_surface, noise_length
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import AnySampling, GraspModel, MeshOptions
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import Label
from grasp3d.surface.area_statistics import quantiles, vertex_weights
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.label_settings import chosen_settings
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.context import begin_step, report_progress, unreported
from grasp3d.system.files import check_suffix
from grasp3d.system.ply_files import write_ply_columns
from grasp3d.system.tables import SUFFIXES as TABLES
from grasp3d.system.tables import write_columns
from grasp3d.system.versions import package_version
from grasp3d.validating.perturbing.noise_settings import NoiseSettings

MOST_UNCONFIRMED = 0.01
"""Largest fraction of the area that is S with the advised errors where fewer copies than required
are S: single vertices with triangles of unusual shape must not decide for all."""

MUCH_LESS = 0.5
"""Part of the area that is S with the measured turn which the check may at most cost."""


@dataclass(frozen=True)
class Advice:
    """What to enter for a scan, so that what is S is S in most noisy copies.

    The normal error of the model that was given is contained in that to enter.
    """

    normal_error: float
    """To enter as `normal_error` [rad]: the larger of the measured turn of the normals and the
    least error that passes the check. Where that leaves too little S, the measured turn."""
    location_error: float
    """To enter as `location_error`, in the mesh's unit."""
    measured_turn: float
    """Angle within which the normals turned, at the level of the settings, over area and copies
    [rad]."""
    stable_fraction: float
    """Area fraction that is S with the errors to enter."""
    unconfirmed_fraction: float
    """Fraction of that area where fewer copies than required are S."""

    @property
    def passed(self) -> bool:
        """Whether the check is passed: with these errors nearly all of S is S in enough copies."""
        return self.stable_fraction > 0.0 and self.unconfirmed_fraction <= MOST_UNCONFIRMED


@dataclass(frozen=True, eq=False)
class Perturbation:
    """Labels of noisy copies of a surface, vertex by vertex, and the errors to enter for it.

    Arrays have one row for each vertex of `labels.mesh`, (V,). S, M and U of a copy are those of
    the best grasp that is found there, not of one grasp in all copies; `kept` is about one grasp.
    """

    labels: SurfaceLabels
    """The labels of the surface itself, without further errors."""
    settings: NoiseSettings
    """How the copies were made; `noise` is a number here, in the mesh's unit."""
    estimated: bool
    """Whether the noise was estimated from the surface's roughness."""
    stable: Floats
    """Fraction of the copies that are S."""
    ambiguous: Floats
    """Fraction of the copies that are M."""
    unstable: Floats
    """Fraction of the copies in which no grasp was found, U."""
    kept: Floats
    """Fraction of the copies in which the surface's own best grasp, with contacts at the same
    surface points, is S; nan where it has none."""
    critical_angle_low: Floats
    """Critical friction angle of the copies [rad]: the value that a fraction 1 - `settings.level`
    of them does not exceed; inf: no grasp."""
    critical_angle_high: Floats
    """The value that a fraction `settings.level` of the copies does not exceed [rad]."""
    normal_turn: Floats
    """Angle by which the normal turned, at the same level [rad]."""
    shift: Floats
    """How far the vertex moved, at the same level, in the mesh's unit."""
    shift_across: float
    """How far contacts moved across the line between them, at the same level over area and copies,
    in the mesh's unit; for three fingers and more, how far vertices moved."""
    confirmed_fraction: float
    """Area fraction of what is S in the copies whose grasp is S on the surface itself. Noise that
    makes normals look opposed is found by the search, so it is smaller than for given grasps."""
    advice: Advice
    """The errors to enter, and how they were checked."""

    __repr__ = short_repr

    @property
    def mesh(self) -> ObjectMesh:
        """The surface."""
        return self.labels.mesh

    @property
    def model(self) -> GraspModel:
        """The model with the errors to enter; see `Advice.passed`.

        Raises:
            SettingError: The normal error is 90 degrees or more.
        """
        advice = self.advice
        return replace(
            self.labels.model,
            normal_error=advice.normal_error,
            location_error=advice.location_error,
        )

    @property
    def fractions(self) -> dict[Label, Floats]:
        """Fraction of the copies that have each label, (V,) each."""
        return {Label.S: self.stable, Label.M: self.ambiguous, Label.U: self.unstable}

    def columns(self) -> dict[str, Any]:
        """Arrays over the vertices by the names that they have in files, (V,) each."""
        names = (
            "stable", "ambiguous", "unstable", "kept", "critical_angle_low", "critical_angle_high",
            "normal_turn", "shift",
        )  # fmt: skip
        return {name: getattr(self, name) for name in names}


SUFFIXES = (".ply", *TABLES)
"""Endings of the files."""


def write_perturbation(path: str | Path, perturbation: Perturbation) -> None:
    """Write the results of noisy copies for each vertex.

    A PLY is the surface with x y z, outward nx ny nz and the properties below (float, angles in
    radians; nan and inf where there is no grasp); the settings are in comments that begin with
    `grasp3d`. CSV and Parquet have a row for each vertex with x y z and the same columns:
    `stable`, `ambiguous`, `unstable`, `kept`, `critical_angle_low`, `critical_angle_high`,
    `normal_turn`, `shift`.

    Args:
        path: File to make or replace; .ply, .csv or .parquet.
        perturbation: The results.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.validating import perturbing
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), max_edge=9.0)
        >>> noisy = perturbing.perturb_surface(ball)
        >>> perturbing.write_perturbation("noise.ply", noisy)
        >>> trimesh.load_mesh("noise.ply").vertices.shape == noisy.mesh.vertices.shape
        True
    """
    path = Path(path)
    check_suffix(path, SUFFIXES, "table or mesh")
    if path.suffix.lower() == ".ply":
        _write_ply(path, perturbation)
        return
    position = {axis: perturbation.mesh.vertices[:, k] for k, axis in enumerate("xyz")}
    write_columns(path, {**position, **perturbation.columns()}, settings=settings_of(perturbation))


def settings_of(perturbation: Perturbation) -> dict[str, Any]:
    """Settings of the copies and the errors to enter; angles in radians."""
    labels, advice = perturbation.labels, perturbation.advice
    return {
        "version": package_version(),
        **chosen_settings(labels.mesh, labels.model, labels.sampling, labels.mode),
        **plain_values(perturbation.settings),
        "noise_from": "roughness" if perturbation.estimated else "given",
        **{f"advised_{name}": getattr(advice, name) for name in ("normal_error", "location_error")},
    }


def _write_ply(path: Path, perturbation: Perturbation) -> None:
    mesh = perturbation.mesh
    columns = {
        **{axis: mesh.vertices[:, k].astype("<f8") for k, axis in enumerate("xyz")},
        **{f"n{axis}": -mesh.normals[:, k].astype("<f4") for k, axis in enumerate("xyz")},
        **{name: values.astype("<f4") for name, values in perturbation.columns().items()},
    }
    write_ply_columns(path, columns, mesh.faces, settings_of(perturbation))


def advise(labels: SurfaceLabels, confirmed: Bools, turn: float, across: float) -> Advice:
    """Choose errors with which S holds in most copies, and check them.

    The surface is labelled again with the location error; as its margin falls by every further
    normal error as much, one labelling checks all of them.

    Args:
        labels: The labels of the surface itself.
        confirmed: Whether enough copies are S at each vertex, (V,).
        turn: Measured turn of the normals [rad].
        across: Measured shift of the contacts, in the mesh's unit.
    """
    location, areas = _rounded_up(across), labels.mesh.vertex_areas
    model = replace(labels.model, location_error=location)
    located = label_surface(labels.mesh, model, sampling=labels.sampling)
    least = least_error(located.margin, confirmed, areas)
    error = math.radians(
        _rounded_up(math.degrees(error_to_enter(located.margin, least, turn, areas)))
    )
    stable = located.margin > error
    area, own = float(areas[stable].sum()), labels.model.normal_error
    return Advice(
        normal_error=own + error,
        location_error=location,
        measured_turn=turn,
        stable_fraction=area / float(areas.sum()),
        unconfirmed_fraction=float(areas[stable & ~confirmed].sum()) / area if area else 0.0,
    )


def error_to_enter(margin: Floats, least: float, turn: float, areas: Floats) -> float:
    """Choose the larger of two errors, unless it leaves much less S than the measured turn.

    On some scans a rough part, such as a fine thread, is S in too few copies at any error that
    leaves anything S elsewhere.

    Args:
        margin: Margins without normal error [rad], (V,).
        least: The least error that passes the check [rad]; inf: none.
        turn: Measured turn of the normals [rad].
        areas: Areas of the vertices, (V,).
    """
    larger = max(turn, least)
    area, most = (float(areas[margin > error].sum()) for error in (larger, turn))
    return larger if area > MUCH_LESS * most else turn


def least_error(margin: Floats, confirmed: Bools, areas: Floats) -> float:
    """The smallest error that leaves nearly only confirmed vertices S.

    Args:
        margin: Margins [rad]: with an error e, vertices whose margin is above e are S; (V,).
        confirmed: Whether enough copies are S there, (V,).
        areas: Areas of the vertices, (V,).

    Returns:
        The error [rad], at least 0; inf: whatever the error, too much of what is S is not
        confirmed, or nothing is S.
    """
    rows = np.flatnonzero(margin > 0.0)
    rows = rows[np.argsort(-margin[rows], kind="stable")]
    area = np.cumsum(areas[rows])
    failed = np.cumsum(np.where(confirmed[rows], 0.0, areas[rows]))
    passing = (failed <= MOST_UNCONFIRMED * area) & (area > 0.0)
    # An error at one vertex's margin excludes it: a border must lie between different margins.
    below = np.append(margin[rows][1:], 0.0)
    passing &= below < margin[rows]
    return float(below[passing].min()) if passing.any() else math.inf


def _rounded_up(number: float) -> float:
    """Round up to two digits, as what is typed."""
    if not 0.0 < number < math.inf:
        return number
    step = 10.0 ** (math.floor(math.log10(number)) - 1)
    return float(f"{math.ceil(number / step - 1e-9) * step:.12g}")


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
