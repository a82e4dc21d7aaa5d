"""Labelling of noisy copies of a scan."""

import math
from dataclasses import replace

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, locked
from grasp3d.errors import SettingError
from grasp3d.mesh import MeshSource
from grasp3d.mesh.noise_lengths import noise_length
from grasp3d.mesh.noisy_copies import MovableSurface, movable_surface
from grasp3d.perturbing.advice import Advice, advise
from grasp3d.perturbing.copies import CopyResult, Singles, examine_copy, noisy_copies
from grasp3d.perturbing.noise_settings import NoiseSettings
from grasp3d.perturbing.perturbation import Perturbation
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.stability.label import Label
from grasp3d.surface.area_statistics import quantiles, vertex_weights
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.progress import Progress, ignore
from grasp3d.system.steps import begin_step

MOST_NOISE = 0.1
"""Largest noise, in object sizes: more leaves nothing of the shape."""


def perturb_surface(
    mesh: MeshSource,
    model: GraspModel | None = None,
    *,
    noise: NoiseSettings | None = None,
    sampling: Sampling | None = None,
    options: MeshOptions | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Perturbation:
    """Label noisy copies of a scan, and find the errors to enter for it.

    The vertices of each copy are moved along their normals at random; along the surface an error
    would not change its shape. Vertices that divide long edges move with their faces. A copy is
    searched anew for the best grasp at each vertex.

    Args:
        mesh: The scan: a path or an object, as in `load_mesh`.
        model: Friction, sensor resolution and normal error without noise; None: the defaults.
        noise: Noise of the copies, and their number; None: the defaults.
        sampling: How grasps are searched for; None: the defaults.
        options: How the mesh is read and prepared; None: those of an `ObjectMesh`, or the defaults.
        threads: Threads to use; None: one per processor. The result does not depend on it.
        progress: Called with the fraction of the work done, from 0 to 1.

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
        >>> from grasp3d.perturbing import NoiseSettings, perturb_surface
        >>> ball = trimesh.creation.icosphere(3)
        >>> errors = np.random.default_rng(0).normal(0.0, 0.005, len(ball.vertices))
        >>> scan = ball.vertices * (1.0 + errors)[:, None], ball.faces
        >>> noise, options = NoiseSettings(noise=0.005, copies=8), grasp3d.MeshOptions(max_edge=9.0)
        >>> found = perturb_surface(scan, noise=noise, options=options)
        >>> found.stable.shape, bool(found.advice.unconfirmed_fraction <= 0.01)
        ((642,), True)
    """
    surface = movable_surface(mesh, options, threads=threads)
    return perturb_movable(
        surface, model, noise=noise, sampling=sampling, threads=threads, progress=progress
    )


def perturb_movable(
    surface: MovableSurface,
    model: GraspModel | None = None,
    *,
    noise: NoiseSettings | None = None,
    sampling: Sampling | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Perturbation:
    """Like `perturb_surface`, of a surface that is prepared already.

    Args:
        surface: The scan.
        model: As in `perturb_surface`, like all others.
        noise: Noise of the copies, and their number.
        sampling: How grasps are searched for.
        threads: Threads to use.
        progress: Called with the fraction of the work done, from 0 to 1.

    Raises:
        SettingError: As in `perturb_surface`.
        MeshError: No noise is given and none can be measured.
    """
    report, mesh = progress or ignore, surface.mesh
    settings, chosen = mesh.in_own_unit(noise or NoiseSettings(), model or GraspModel())
    _check_model(chosen)
    begin_step("estimating the noise")
    sigma = _sigma(surface, settings)
    labels = label_surface(mesh, chosen, sampling=sampling, threads=threads)
    begin_step("labelling noisy copies")
    results = []
    for copy in noisy_copies(
        surface, sigma, settings.correlation, settings.seed, settings.copies, threads=threads
    ):
        results.append(examine_copy(labels, copy))
        report(len(results) / (settings.copies + 1))
    found = _gathered(
        labels, results, replace(settings, noise=sigma), estimated=settings.noise is None
    )
    report(1.0)
    return found


def _check_model(model: GraspModel) -> None:
    """Refuse models whose labels are no thresholds on critical friction angles."""
    if model.method != "exact":
        raise SettingError("noisy copies need the method exact; method extremes has no margins")
    if not model.is_uniform:
        raise SettingError(
            "noisy copies are labelled without location_error and per_finger: leave them out here, "
            "and add them to the errors of the result"
        )


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
    return noise_length(surface, settings.correlation, seed=settings.seed)


def _gathered(
    labels: SurfaceLabels, results: list[CopyResult], settings: NoiseSettings, *, estimated: bool
) -> Perturbation:
    """Fractions and quantiles over the copies."""
    level = settings.level
    codes = np.stack([one.label for one in results])
    angles = np.stack([one.critical_angle for one in results])
    turns, shifts = (
        np.stack([getattr(one, name) for one in results]) for name in ("turn", "shift")
    )
    parts = {label: locked((codes == label).mean(axis=0)) for label in Label}
    kept = np.mean([one.kept for one in results], axis=0)
    across = _quantile(labels, np.stack([one.across for one in results]), level)
    return Perturbation(
        labels=labels,
        settings=settings,
        estimated=estimated,
        stable=parts[Label.S],
        ambiguous=parts[Label.M],
        unstable=parts[Label.U],
        kept=locked(np.where(np.isinf(labels.critical_angle), math.nan, kept)),
        critical_angle_low=_over_copies(angles, 1.0 - level),
        critical_angle_high=_over_copies(angles, level),
        normal_turn=_over_copies(turns, level),
        shift=_over_copies(shifts, level),
        shift_across=across,
        confirmed_fraction=_confirmed(results),
        advice=_advice(labels, codes, _quantile(labels, turns, level), across, level),
    )


def _advice(
    labels: SurfaceLabels, codes: Bytes, turn: float, across: float, level: float
) -> Advice:
    needed = math.ceil(level * len(codes) - 1e-9)
    enough: Bools = (codes == Label.S).sum(axis=0) >= needed
    return advise(labels, enough, turn, across)


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


def _confirmed(results: list[CopyResult]) -> float:
    """Area fraction of what is S in copies whose grasp is S on the surface itself; nan: nothing."""
    stable = sum(one.stable_area for one in results)
    return sum(one.right_area for one in results) / stable if stable else math.nan
