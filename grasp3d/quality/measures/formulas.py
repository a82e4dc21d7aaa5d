"""Measures of wrenches, of forces, and of the contacts' positions, with their sources.

Of the grasp matrix: its singular values in the span of the grasp. Of the primitive wrenches: volume
of their hull, min-weight metric. Of internal forces: how far they can stay from the borders of the
friction cones.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import block_diag
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import Bools, Floats, Ints, angles_between
from grasp3d.contact.friction_cones import edge_angles
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.measures.geometry import GraspGeometry, Measured, Metric

TOGETHER = 32
"""Programs solved as one: a call of the solver costs more than a small program."""

TOLERANCE = 1e-10
"""Largest violation of a constraint; rows and unknowns are of size 1."""

NUMERICAL_DIFFICULTIES = 4
"""Status of a program of which the solver found nothing out."""


@dataclass(frozen=True, eq=False)
class Program:
    """Maximise the first unknown x[0], with `equal @ x = constants` and `below @ x <= 0`."""

    equal: Floats
    """Shape (e, v)."""
    constants: Floats
    """Shape (e,)."""
    below: Floats
    """Shape (k, v); k may be 0."""
    least: Floats
    """Lower bounds of the unknowns, shape (v,)."""
    most: Floats
    """Upper bounds, shape (v,)."""


def solve(programs: Sequence[Program]) -> Floats:
    """The largest first unknown of each program, shape (p,); nan where there is no solution."""
    values = np.full(len(programs), np.nan)
    for start in range(0, len(programs), TOGETHER):
        chunk = programs[start : start + TOGETHER]
        values[start : start + len(chunk)] = _solve_together(chunk)
    return values


def _solve_together(programs: Sequence[Program], *, presolve: bool = True) -> Floats:
    """Solve programs as one with blocks; divide them in halves if that has no solution.

    The solver may fail to lead the solution of a simplified program back to the program itself; one
    of which it neither finds a solution nor that there is none is solved as it is.
    """
    widths = np.array([len(program.least) for program in programs])
    first = np.concatenate([[0], np.cumsum(widths)[:-1]])
    cost = np.zeros(widths.sum())
    cost[first] = -1.0
    below = _blocks([program.below for program in programs])
    bounds: Any = np.concatenate(
        [np.stack([program.least, program.most], axis=1) for program in programs]
    )
    from scipy.optimize import linprog

    result = linprog(
        cost,
        A_eq=_blocks([program.equal for program in programs]),
        b_eq=np.concatenate([program.constants for program in programs]),
        A_ub=below if below.shape[0] else None,
        b_ub=np.zeros(below.shape[0]) if below.shape[0] else None,
        bounds=bounds,
        method="highs",
        options={
            "presolve": presolve,
            "primal_feasibility_tolerance": TOLERANCE,
            "dual_feasibility_tolerance": TOLERANCE,
        },
    )
    if result.status == 0 and result.x is not None:
        return np.asarray(result.x[first], dtype=np.float64)
    if len(programs) == 1:
        undecided = result.status == NUMERICAL_DIFFICULTIES and presolve
        return _solve_together(programs, presolve=False) if undecided else np.array([np.nan])
    half = len(programs) // 2
    return np.concatenate([_solve_together(programs[:half]), _solve_together(programs[half:])])


def _blocks(matrices: Sequence[Floats]) -> Any:
    """Sparse matrix with the given ones along its diagonal."""
    return block_diag(matrices, format="csr")


BESIDE_ORIGIN = 1e-9
"""Part of the vector of ones outside the wrenches' column space from which weights exist."""

LEAST_RANK = 5
"""Rank of hard fingers on a line; below it contacts coincide, or have no friction."""

FLAT = 1e-9
"""Width relative to the length from which contacts are not on one line."""

NEAR = 1e-9
"""Distance relative to the grasp's size from which two contacts do not coincide."""

ROUND = 1e-6
"""Difference of two extents of the contacts, relative to the larger, from which they differ."""

NO_EQUILIBRIUM = "no forces of the fingers are in equilibrium"
AT_ONE_POINT = "all contacts are at one point"
NO_PLANE = "the contacts are nearest to no single plane"
NO_AXIS = "no longest principal axis of the object is given"
"""Why measures are undefined."""

_COLUMN = "a soft finger adds the column e n of torsional moment per normal force"
_PRIMITIVES = "a soft finger adds its normal force with the moments +e and -e as primitive wrenches"

_METRICS: dict[str, Metric] = {}

METRICS: Mapping[str, Metric] = _METRICS
"""Known quality measures by name, in the order of tables."""

Measure = Callable[[GraspGeometry], Measured]


def _metric(
    term: str, text: str, formula: str, source: str, **others: Any
) -> Callable[[Measure], Measure]:
    """Add a function to the known measures, with its description as of `Metric`."""

    def add(measure: Measure) -> Measure:
        name = measure.__name__
        _METRICS[name] = Metric(name, term, text, formula, source, **others, measure=measure)
        return measure

    return add


@_metric(
    "smallest singular value of the grasp matrix",
    "how far the grasp is from one that cannot move the object in some direction",
    r"\sigma_{min}(G)",
    "Li & Sastry 1988",
    torsion=_COLUMN,
)
def smallest_singular_value(grasps: GraspGeometry) -> Measured:
    """Smallest singular value in the span of the grasp."""
    return _of_rank(grasps, _smallest(grasps))


@_metric(
    "volume of the ellipsoid in the wrench space",
    "how much wrench unit contact forces make in all directions together",
    r"\sqrt{\det(G G^T)} = \prod_k \sigma_k",
    "Li & Sastry 1988",
    torsion=_COLUMN,
)
def grasp_matrix_volume(grasps: GraspGeometry) -> Measured:
    """Product of the singular values in the span of the grasp."""
    values = grasps.singular_values
    product = np.where(values > 0.0, values, 1.0).prod(axis=1)
    return _of_rank(grasps, product)


@_metric(
    "grasp isotropy index",
    "how evenly contact forces contribute to wrenches of all directions",
    r"\sigma_{min}(G) / \sigma_{max}(G)",
    "Kim et al. 2001",
    torsion=_COLUMN,
    most=1.0,
)
def grasp_isotropy(grasps: GraspGeometry) -> Measured:
    """Smallest divided by largest singular value in the span of the grasp."""
    return _of_rank(grasps, _smallest(grasps) / grasps.singular_values[:, 0])


def _smallest(grasps: GraspGeometry) -> Floats:
    values = grasps.singular_values
    return np.asarray(np.where(values > 0.0, values, np.inf).min(axis=1))


def _of_rank(grasps: GraspGeometry, values: Floats) -> Measured:
    return Measured.of(values, *_below_rank(grasps.rank, "the grasp matrix has rank {}"))


@_metric(
    "volume of the grasp wrench space",
    "volume of the convex hull of the primitive wrenches, whether or not it contains 0",
    r"\operatorname{vol}(\operatorname{conv}\{w_j\})",
    "Miller & Allen 1999",
    torsion=_PRIMITIVES,
)
def wrench_space_volume(grasps: GraspGeometry) -> Measured:
    """Volume of the hull of the primitive wrenches in their span."""
    span_rank = (grasps.primitive_span.sizes > 0.0).sum(axis=1)
    values = np.full(grasps.size, np.nan)
    for row in np.flatnonzero(span_rank >= LEAST_RANK):
        values[row] = _hull_volume(grasps.primitives[row], int(span_rank[row]))
    thin = _below_rank(span_rank, "the wrenches span {} dimensions")
    return Measured.of(values, *thin, (np.isnan(values), "the hull of the wrenches is too flat"))


def _hull_volume(rows: Floats, rank: int) -> float:
    """Volume in the span of wrenches (k, 6); nan if Qhull finds them too flat."""
    # In coordinates in which the hull extends alike in all directions: Qhull's tolerances are
    # those of its longest.
    left, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    try:
        volume = ConvexHull(left[:, :rank]).volume
    except QhullError:
        return float("nan")
    return float(volume * sizes[:rank].prod())


def _below_rank(ranks: Ints, text: str) -> list[tuple[Bools, str]]:
    """Masks of the ranks below the least one, with the reason why there is no measure."""
    return [
        (ranks == rank, f"{text.format(rank)}, less than {LEAST_RANK}")
        for rank in range(LEAST_RANK)
    ]


@_metric(
    "min-weight metric",
    "largest smallest weight with which the primitive wrenches combine to 0; above 0 exactly "
    "if the grasp with these polygonal cones is force-closed",
    r"\max_c \min_j c_j, \sum_j c_j w_j = 0, \sum_j c_j = 1",
    "Li et al. 2023",
    torsion=_PRIMITIVES,
    least=-math.inf,
    most=1.0,
)
def min_weight(grasps: GraspGeometry) -> Measured:
    """Largest smallest weight of a combination of the primitive wrenches that is 0."""
    coordinates, used = grasps.primitive_span.rows, grasps.used_primitives
    ones = used.astype(np.float64)
    inside = (coordinates @ (np.swapaxes(coordinates, 1, 2) @ ones[..., None]))[..., 0]
    beside = np.linalg.norm(ones - inside, axis=1) <= BESIDE_ORIGIN * np.sqrt(used.sum(axis=1))
    open_rows = np.flatnonzero(~beside & ~grasps.at_one_point)
    values = np.full(grasps.size, np.nan)
    values[open_rows] = solve([_weights_of(coordinates[k][used[k]]) for k in open_rows])
    return Measured.of(
        values,
        (grasps.at_one_point, AT_ONE_POINT),
        (beside, "no weights of sum 1 balance the primitive wrenches"),
        (np.isnan(values), "the linear program was not solved"),
    )


def _weights_of(rows: Floats) -> Program:
    """Unknowns: the smallest weight, and by how much each weight exceeds it."""
    scaled = rows * np.sqrt(len(rows))  # rows of size 1
    balance = np.vstack([scaled.sum(axis=0), scaled]).T  # (6, 1 + k)
    balance = balance[np.any(scaled != 0.0, axis=0)]
    total = np.concatenate([[float(len(rows))], np.ones(len(rows))])
    return Program(
        equal=np.vstack([balance, total]),
        constants=np.concatenate([np.zeros(len(balance)), [1.0]]),
        below=np.zeros((0, 1 + len(rows))),
        least=np.concatenate([[-np.inf], np.zeros(len(rows))]),
        most=np.full(1 + len(rows), np.inf),
    )


@_metric(
    "margin of internal forces",
    "largest distance of forces in equilibrium from the borders of the polygonal friction "
    "cones, their normal components being 1 together; below 0 they must leave the cones",
    r"\max_f \min_{i,k} d_k(f_i), \sum_i G_i f_i = 0, \sum_i n_i \cdot f_i = 1",
    "Kerr & Roth 1986",
    torsion="a soft finger may use torsion, which takes |moment|/e from its normal force",
    least=-math.inf,
    most=0.5,
)
def internal_force_margin(grasps: GraspGeometry) -> Measured:
    """Largest distance of internal forces from the borders of the cones (Kerr & Roth 1986)."""
    rows = np.flatnonzero(~grasps.at_one_point)
    values = np.full(grasps.size, np.nan)
    values[rows] = solve([_forces_of(grasps, int(row)) for row in rows])
    return Measured.of(
        values, (grasps.at_one_point, AT_ONE_POINT), (np.isnan(values), NO_EQUILIBRIUM)
    )


def _forces_of(grasps: GraspGeometry, row: int) -> Program:
    """The program of one grasp.

    Its unknowns are the margin, each contact's force along normal and tangents and torsional moment
    divided by its radius, and for each contact a number of at least the size of that moment.
    """
    count = grasps.count
    balance = grasps.axis_span.rows[row].T * math.sqrt(count)  # (6, 4 n)
    balance = balance[np.any(balance != 0.0, axis=1)]
    equal = np.zeros((len(balance) + 1, 1 + 5 * count))
    equal[:-1, 1 : 1 + 4 * count] = balance
    equal[-1, 1 : 1 + 4 * count : 4] = 1.0  # all normal forces together are 1
    unlimited = np.where(grasps.used_axes[row], np.inf, 0.0)  # (n, 4)
    most = np.concatenate([[np.inf], unlimited.ravel(), unlimited[:, 3]])
    least = -most
    least[1 : 1 + 4 * count : 4] = 0.0  # fingers press
    return Program(
        equal=equal,
        constants=np.concatenate([np.zeros(len(balance)), [1.0]]),
        below=np.vstack([_cone_faces(grasps, row), _moment_limits(count)]),
        least=least,
        most=most,
    )


def _cone_faces(grasps: GraspGeometry, row: int) -> Floats:
    """Margin less the distance to each face of each cone, shape (m n, 1 + 5 n)."""
    count, edges = grasps.count, grasps.edges
    middles = edge_angles(edges, math.pi / edges)  # the faces are between the edges
    apothem = math.cos(math.pi / edges)
    faces = np.zeros((count, edges, 1 + 5 * count))
    faces[..., 0] = 1.0
    for contact in range(count):
        slope = math.atan(float(grasps.contacts.friction[row, contact]) * apothem)
        force = 1 + 4 * contact
        faces[contact, :, force] = -math.sin(slope)
        faces[contact, :, force + 1] = math.cos(slope) * np.cos(middles)
        faces[contact, :, force + 2] = math.cos(slope) * np.sin(middles)
        # Torsion takes its part of the normal force.
        faces[contact, :, 1 + 4 * count + contact] = math.sin(slope)
    return faces.reshape(count * edges, -1)


def _moment_limits(count: int) -> Floats:
    """The last unknowns are at least the moments, either way round, shape (2 n, 1 + 5 n)."""
    limits = np.zeros((2, count, 1 + 5 * count))
    contact = np.arange(count)
    limits[:, contact, 1 + 4 * count + contact] = -1.0
    limits[0, contact, 4 + 4 * contact] = 1.0
    limits[1, contact, 4 + 4 * contact] = -1.0
    return limits.reshape(2 * count, -1)


@_metric(
    "margin of the friction angle",
    "largest smallest angle between forces in equilibrium and the borders of their circular "
    "friction cones",
    r"\beta - \beta^*",
    "Wan & Howe 2018",
    least=-math.pi,
    most=math.pi,
    unit="rad",
)
def friction_margin(grasps: GraspGeometry) -> Measured:
    """Friction angle less the critical friction angle."""
    contacts = grasps.contacts
    angles = critical_friction_angle(contacts, tolerance=grasps.tolerance)
    own = contacts.friction_angle
    finite = np.where(np.isfinite(angles), angles, 0.0)
    return Measured.of(
        own[:, 0] - finite,
        (grasps.at_one_point, AT_ONE_POINT),
        ((own != own[:, :1]).any(axis=1), "the fingers' friction differs"),
        (~np.isfinite(angles), NO_EQUILIBRIUM),
    )


class _Plane(NamedTuple):
    """The plane nearest to the contacts."""

    flat: Floats
    """Contacts in the plane, in order of their angle about the mean, shape (b, n, 2)."""
    line: Floats
    """Unit direction in which the contacts extend most, shape (b, 3)."""
    normal: Floats
    """Unit normal, shape (b, 3)."""
    collinear: Bools
    """Whether the contacts are on one line, shape (b,)."""
    ambiguous: Bools
    """Whether other planes are as near, as for a regular tetrahedron, shape (b,)."""


@_metric(
    "distance between the grasp's centroid and the centre of mass",
    "lever arm of weight and inertia",
    r"\lVert \frac{1}{n} \sum_i p_i \rVert",
    "Ding et al. 2001",
    better="smaller",
    unit="length",
)
def centroid_distance(grasps: GraspGeometry) -> Measured:
    """Distance of the contacts' mean from the centre of mass."""
    return Measured.of(np.linalg.norm(grasps.contacts.points.mean(axis=1), axis=-1))


@_metric(
    "area of the grasp polygon",
    "area of the polygon of the contacts, in the plane nearest to them",
    r"\operatorname{area}(p_1 \dots p_n)",
    "Mirtich & Canny 1994",
    unit="length²",
    fingers=3,
)
def polygon_area(grasps: GraspGeometry) -> Measured:
    """Area of the finger polygon in its plane."""
    plane = _plane(grasps)
    corners = plane.flat
    following = np.roll(corners, -1, axis=1)
    cross = corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]
    area = 0.5 * np.abs(cross.sum(axis=1)) * grasps.extent**2
    return Measured.of(area, (plane.ambiguous, NO_PLANE))


@_metric(
    "shape of the grasp polygon",
    "difference of its inner angles from those of the regular polygon; 0: regular, 1: a line",
    r"\frac{1}{\theta_{max}} \sum_i \lvert \theta_i - \bar\theta \rvert",
    "Kim et al. 2001",
    better="smaller",
    most=1.0,
    fingers=3,
)
def polygon_shape(grasps: GraspGeometry) -> Measured:
    """Difference of the polygon's inner angles from the regular ones; 0: regular, 1: a line."""
    plane, count = _plane(grasps), grasps.count
    regular = math.pi * (count - 2) / count
    worst = (count - 2) * (math.pi - regular) + 2.0 * regular
    difference = np.abs(_inner_angles(plane.flat) - regular).sum(axis=1) / worst
    # A concave polygon may differ more than one that is a line.
    values = np.where(plane.collinear, 1.0, np.minimum(difference, 1.0))
    return Measured.of(
        values,
        (_any_coincide(plane.flat), "two contacts coincide in the plane of the polygon"),
        (plane.ambiguous, NO_PLANE),
    )


def _inner_angles(corners: Floats) -> Floats:
    """Inner angles of polygons (b, n, 2) in counter-clockwise order [rad], shape (b, n)."""
    ahead = np.roll(corners, -1, axis=1) - corners
    behind = np.roll(corners, 1, axis=1) - corners
    cross = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    angles = np.arctan2(cross, (ahead * behind).sum(axis=-1))
    return np.asarray(np.where(angles < 0.0, angles + 2.0 * math.pi, angles))


def _any_coincide(points: Floats) -> Bools:
    """Whether any two of the points (b, n, 2) of each grasp coincide, shape (b,)."""
    first, second = np.triu_indices(points.shape[1], 1)
    gaps = np.linalg.norm(points[:, first] - points[:, second], axis=-1)
    return np.asarray((gaps <= NEAR).any(axis=1))


@_metric(
    "orthogonality",
    "angle from the grasp's axis to the nearest of parallel and orthogonal to the object's "
    "longest principal axis; the grasp's axis is the line through the contacts, of three and "
    "more the normal of their plane",
    r"\min(\delta, \frac{\pi}{2} - \delta)",
    "Balasubramanian et al. 2012",
    better="smaller",
    most=math.pi / 4.0,
    unit="rad",
)
def orthogonality(grasps: GraspGeometry) -> Measured:
    """Angle between the grasp's axis and the object's, or its complement if that is smaller."""
    plane, axis = _plane(grasps), grasps.principal_axis
    on_line = plane.collinear | (grasps.count == 2)
    direction = np.where(on_line[:, None], plane.line, plane.normal)
    angle = angles_between(direction, axis)
    angle = np.minimum(angle, math.pi - angle)
    return Measured.of(
        np.minimum(angle, math.pi / 2.0 - angle),
        (np.asarray(np.isnan(axis).any(axis=1)), NO_AXIS),
        (grasps.at_one_point, AT_ONE_POINT),
        (plane.ambiguous & ~on_line, NO_PLANE),
    )


def _plane(grasps: GraspGeometry) -> _Plane:
    """The plane of least squares, with lengths relative to the grasp's size."""
    points = grasps.centred_points
    _, sizes, axes = np.linalg.svd(points)
    flat = points @ np.swapaxes(axes[:, :2], 1, 2)  # (b, n, 2)
    order = np.argsort(np.arctan2(flat[..., 1], flat[..., 0]), axis=1, kind="stable")
    flat = np.take_along_axis(flat, order[..., None], axis=1)
    second, third = sizes[:, 1], sizes[:, 2] if sizes.shape[1] > 2 else np.zeros(len(sizes))
    collinear = second <= FLAT * sizes[:, 0]
    ambiguous = ~collinear & (second - third <= ROUND * second)
    return _Plane(flat, axes[:, 0], axes[:, 2], collinear, ambiguous)
