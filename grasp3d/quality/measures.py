"""Quality measures of the literature: epsilon of pyramids, singular values, volume, min-weight."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from grasp3d._kernels.hull.polytope import SCRATCH_ROWS
from grasp3d._kernels.hull.wrench_resistance import least_multiples
from grasp3d.arrays import Bools, Floats, locked, shaped
from grasp3d.contact.contacts import Contacts, centred
from grasp3d.errors import SettingError
from grasp3d.quality.ferrari_canny import epsilon
from grasp3d.quality.wrenches import check_torque_scale, wrench_axes, wrenches

ALL = "all"
"""Stands for the names of all measures."""

TOLERANCE = 1e-10
"""Relative gap between the bounds of the smallest weight."""

RANK_TOLERANCE = 1e-10
"""Size of a singular value, relative to the largest, from which it adds to the rank."""

LEAST_RANK = 5
"""Rank of hard fingers on a line; below it contacts coincide, or have no friction."""

SAME_POINT = 1e-12
"""Size of a grasp, relative to its distance from the centre of mass, up to which it is rounding."""

BESIDE_ORIGIN = 1e-9
"""Part of the vector of ones outside the wrenches' column space beyond which weights exist."""


def metrics(
    contacts: Contacts,
    names: str | Sequence[str] = ALL,
    *,
    torque_scale: float = 1.0,
    edges: int = 8,
) -> dict[str, Floats]:
    """Quality measures of the literature; the larger, the better.

    Singular values and the volume of the wrench space are those in the span of the grasp, as
    epsilon is. `min_weight` depends neither on the centre of mass nor on the torque scale.

    Args:
        contacts: Point contacts.
        names: 'all', names of measures in a list, or separated by commas in one text.
        torque_scale: Length that torques are divided by [m]; with
            `ObjectMesh.torque_scale` nothing depends on the unit.
        edges: Edges of the polygonal friction cones; their angles about the normal are those of
            `epsilon`.

    Returns:
        Values by name, each of the batch's shape; nan where a measure is undefined.

    Raises:
        SettingError: An unknown name, or a setting outside its range.

    Example:
        Three fingers around a disc of radius 1, at 120 degrees from each other:

        >>> import numpy as np
        >>> import grasp3d
        >>> from grasp3d.quality import metrics
        >>> angle = np.radians([0.0, 120.0, 240.0])
        >>> points = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
        >>> contacts = grasp3d.Contacts(points, -points, friction=0.5)
        >>> found = metrics(contacts, ["grasp_isotropy", "min_weight", "epsilon_linf"])
        >>> {name: round(float(found[name]), 3) for name in found}
        {'grasp_isotropy': 0.707, 'min_weight': 0.042, 'epsilon_linf': 0.6}
    """
    keys = metric_names(names)
    check_torque_scale(torque_scale)
    batch = contacts.batch
    if contacts.count < 2 or not contacts.points.size:
        return {name: locked(np.full(batch, np.nan))[()] for name in keys}
    flat = contacts.reshape((-1,))
    return {name: shaped(_MEASURES[name](flat, torque_scale, edges), batch) for name in keys}


def metric_names(names: str | Sequence[str] = ALL) -> tuple[str, ...]:
    """Names of known measures.

    Args:
        names: 'all', names in a list, or separated by commas in one text.

    Returns:
        Each name once, in the order in which it was given.

    Raises:
        SettingError: A name that is not known, or none at all.

    Example:
        >>> from grasp3d.quality import metric_names
        >>> metric_names("min_weight, grasp_isotropy")
        ('min_weight', 'grasp_isotropy')
    """
    words = names.split(",") if isinstance(names, str) else list(names)
    parts = [str(name).strip() for name in words]
    keys = [name for part in parts for name in (_MEASURES if part == ALL else [part])]
    known = f"known: {ALL}, {', '.join(_MEASURES)}"
    if not any(keys):
        raise SettingError(f"no metric is named; {known}")
    for name in keys:
        if name not in _MEASURES:
            raise SettingError(f"no metric is called {name!r}; {known}")
    return tuple(dict.fromkeys(keys))


def _epsilon(contacts: Contacts, torque_scale: float, edges: int, actuation: Any) -> Floats:
    """Radius of the largest ball around 0 in the wrench space of pyramids."""
    return epsilon(contacts, edges=edges, actuation=actuation, torque_scale=torque_scale).lower


def _singular_values(contacts: Contacts, torque_scale: float) -> tuple[Floats, Floats]:
    """Smallest singular value of the grasp matrix in its span, and divided by the largest, (b,).

    The columns are the wrenches of unit forces along normal and tangents, and of the torsional
    moment that a unit normal force allows.
    """
    rank = (_span(_axes(_about_mean(contacts), 1.0))[1] > 0.0).sum(axis=1)
    values = np.linalg.svd(_axes(contacts, torque_scale), compute_uv=False)
    inside = np.arange(values.shape[1]) < rank[:, None]
    least = np.where(inside & (values > 0.0), values, np.inf).min(axis=1)
    least = np.where(rank < LEAST_RANK, math.nan, least)
    return least, least / values[:, 0]


def _axes(contacts: Contacts, torque_scale: float) -> Floats:
    """Columns of the grasp matrix as rows (b, 4 n, 6); 0 for what contacts do not transmit."""
    used = np.ones((*contacts.friction.shape, 4), dtype=bool)
    used[..., 1:3] = (contacts.friction > 0.0)[..., None]
    used[..., 3] = contacts.torsion_radius > 0.0
    axes = wrench_axes(contacts.points, contacts.normals, contacts.torsion_radius, torque_scale)
    return np.where(used[..., None], axes, 0.0).reshape(len(used), -1, 6)


def _about_mean(contacts: Contacts) -> Contacts:
    """The contacts about their mean, divided by their size: equilibria depend on neither."""
    points, _, size = centred(contacts.points)
    return contacts.of_size(points, size[:, 0, 0])


def _span(rows: Floats) -> tuple[Floats, Floats]:
    """Left singular vectors of wrenches (b, k, 6), forces and torques weighted alike.

    Returns:
        (coordinates, singular values), 0 beyond the rank: weights x are in equilibrium if
        x @ coordinates = 0.
    """
    balanced = np.array(rows)
    for part in (slice(0, 3), slice(3, 6)):
        largest = np.linalg.norm(rows[..., part], axis=-1).max(axis=-1)
        balanced[..., part] /= np.where(largest > 0.0, largest, 1.0)[:, None, None]
    left, sizes, _ = np.linalg.svd(balanced, full_matrices=False)
    inside = sizes > RANK_TOLERANCE * sizes[:, :1]
    return left * inside[:, None], np.where(inside, sizes, 0.0)


def _wrench_space_volume(contacts: Contacts, torque_scale: float, edges: int) -> Floats:
    """Volume of the hull of the primitive wrenches in their span."""
    rows = wrenches(contacts, edges=edges, torque_scale=torque_scale)
    ranks = (_coordinates(contacts, edges)[1] > 0.0).sum(axis=1)
    values = np.full(len(rows), np.nan)
    for row in np.flatnonzero(ranks >= LEAST_RANK):
        values[row] = _hull_volume(rows[row], int(ranks[row]))
    return values


def _hull_volume(rows: Floats, rank: int) -> float:
    """Volume in the span of wrenches (k, 6); nan if Qhull finds them too flat."""
    # The hull extends equally in all directions of these coordinates: Qhull's tolerances follow its
    # longest extent.
    left, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    try:
        hull = ConvexHull(left[:, :rank])
    except QhullError:
        return math.nan
    return float(hull.volume * sizes[:rank].prod())


def _coordinates(contacts: Contacts, edges: int) -> tuple[Floats, Floats, Bools]:
    """Primitive wrenches about the mean, as from `_span`, and which are not copies (b, k)."""
    rows = wrenches(_about_mean(contacts), edges=edges)
    used = np.ones((*contacts.friction.shape, rows.shape[1] // contacts.count), dtype=bool)
    used[..., edges:] = (contacts.torsion_radius > 0.0)[..., None]  # none if all are hard
    mask = used.reshape(rows.shape[:2])
    return *_span(np.where(mask[..., None], rows, 0.0)), mask


def _min_weight(contacts: Contacts, _: float, edges: int) -> Floats:
    """Largest minimum weight with which the primitive wrenches add up to 0; the weights sum to 1.

    With equal weights 1 / k, the k wrenches add up to their mean m. If -m is in F times the hull
    about m, there are weights of at least (1 - F) / k with which they add up to 0.
    """
    coordinates, sizes, used = _coordinates(contacts, edges)
    ones, counts = used.astype(np.float64), used.sum(axis=1)
    inside = (coordinates @ (np.swapaxes(coordinates, 1, 2) @ ones[..., None]))[..., 0]
    beside = np.linalg.norm(ones - inside, axis=1) <= BESIDE_ORIGIN * np.sqrt(counts)
    reach, extent = np.abs(contacts.points).max((1, 2)), np.ptp(contacts.points, axis=1).max(axis=1)
    chosen = np.flatnonzero(~beside & (extent > SAME_POINT * reach))
    means = coordinates.sum(axis=1, keepdims=True) / counts[:, None, None]
    about = np.where(used[..., None], coordinates - means, 0.0)[chosen]
    multiples = np.empty(len(chosen))
    least_multiples(
        np.ascontiguousarray(np.swapaxes(about, 1, 2)), np.ascontiguousarray(-means[chosen, 0]),
        (sizes[chosen] > 0.0).sum(axis=1), np.zeros(6, dtype=np.int64), TOLERANCE,
        np.zeros((SCRATCH_ROWS, 8)), np.zeros((0, 2)), multiples,
    )  # fmt: skip
    values = np.full(len(used), np.nan)
    spare = 1.0 - multiples
    values[chosen] = np.where(np.abs(spare) > TOLERANCE, spare, 0.0) / counts[chosen]
    return values


_MEASURES: Mapping[str, Callable[[Contacts, float, int], Floats]] = {
    "epsilon_l1": partial(_epsilon, actuation="total"),
    "epsilon_linf": partial(_epsilon, actuation="per_finger"),
    "wrench_space_volume": _wrench_space_volume,
    "grasp_isotropy": lambda contacts, scale, _: _singular_values(contacts, scale)[1],
    "smallest_singular_value": lambda contacts, scale, _: _singular_values(contacts, scale)[0],
    "min_weight": _min_weight,
}
"""Known measures by name: functions of a flat batch, the torque scale and the cones' edges."""
