"""Grasps of three or more fingers: where fingers are placed, and the best grasps so far.

The module evaluates single candidate grasps: force closure and the critical friction angle.

Most candidates are rejected because they are not force-closed at the best critical angle found so
far. A grasp that is not force-closed has a separating direction, in which none of its wrenches has
a positive component. The latest separating directions are stored and tried first: the next
candidates share most contacts and are often separated by the same direction, which costs a few
products instead of a hull. Three contacts are evaluated in the plane through them (Ponce & Faverjon
1995), without a hull.

On a crease or at a corner a contact may have any normal of a set, which is contained in a cap about
its centre. What the friction cone about the centre, narrowed by the cap's radius, can do is
possible with every normal of the set. A location error widens the cap by the turn of the contact.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import (
    FixedFloats1,
    FixedFloats2,
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    Ints2,
    UInt64s1,
    merged,
    part,
)
from grasp3d._kernels.hull.growing_hull import AROUND_ORIGIN, grow
from grasp3d._kernels.hull.polytope import Polytope, make_polytope
from grasp3d._kernels.hull.support_functions import SIX, TOTAL, WrenchSpace
from grasp3d._kernels.hull.wrench_problem import SIGN
from grasp3d._kernels.search.coplanar_contacts import (
    arc_sine,
    cones_force_closed,
    critical_of_normals,
    set_cones,
    set_contact_plane,
    set_normal,
)
from grasp3d._kernels.surface.surface_contacts import (
    ContactNormals,
    Surface,
    point_on_face,
    turn_at_vertex,
    turn_on_face,
    walk,
    write_normals,
)
from grasp3d._kernels.surface.vectors import (
    copy,
    cross,
    difference,
    dot,
    norm,
    squared_distance,
    triple,
)

MAX_DIRECTIONS = 24
"""Number of separating directions that are stored."""

MAX_FACETS = (1 << 11) + 8
"""Most facets of a closure test's hull; a grasp that needs more counts as not force-closed."""

ROUNDING = 1e-11
"""Distance of the origin from a hull's facets that rounding errors can explain. As contacts are
apart, no proof by balanced forces is needed."""

RIGHT_ANGLE = 0.5 * math.pi


class Candidate(NamedTuple):
    """A candidate grasp of up to n contacts."""

    points: Floats2
    """Contact points (n, 3), scaled so that grasps are about 1 wide."""
    normals: Floats2
    """Inward unit normals (n, 3); on creases the centre of the set."""
    radii: Floats1
    """Largest angle from it to a normal that the contact may have, turn included [rad] (n,)."""


class HullScratch(NamedTuple):
    """Scratch arrays for the evaluation of more than three contacts."""

    sines: Floats1
    """Sine above which a direction separates each contact's forces (n,)."""
    directions: Floats2
    """Separating directions of earlier candidates, with moments about the first contact, the latest
    successful one first (d, 6)."""
    direction_use: Ints1
    """Number of directions, and the next row to overwrite (2,)."""
    axes: Floats3
    """As in `WrenchSpace` (n, 4, 6)."""
    cones: Floats2
    """As in `WrenchSpace` (n, 2)."""
    metric: Floats1
    """As in `grow` (6,)."""
    polytope: Polytope


def make_candidate(contacts: int) -> Candidate:
    """Allocate a candidate with a number of contacts."""
    return Candidate(
        points=np.zeros((contacts, 3)),
        normals=np.zeros((contacts, 3)),
        radii=np.zeros(contacts),
    )


def make_hull_scratch(contacts: int) -> HullScratch:
    """Allocate the arrays for a number of contacts."""
    return HullScratch(
        sines=np.zeros(contacts),
        directions=np.zeros((MAX_DIRECTIONS, 6)),
        direction_use=np.zeros(2, dtype=np.int64),
        axes=np.zeros((contacts, 4, 6)),
        cones=np.zeros((contacts, 2)),
        metric=np.ones(6),
        polytope=make_polytope(MAX_FACETS),
    )


@merged
def _any_exceeds_elevation(candidate, angle):
    """Whether one of three normals is as steep above the contacts' plane as its cone is wide.

    Balanced forces of three contacts lie in that plane, which such a friction cone does not reach.
    """
    points, radii, sine = candidate.points, candidate.radii, math.sin(angle)
    normal = cross(difference(points[1], points[0]), difference(points[2], points[0]))
    for i in range(3):
        if radii[i] >= angle:
            return True
        own = sine if radii[i] == 0.0 else math.sin(angle - radii[i])
        along = dot(candidate.normals[i], normal)
        if along * along >= own * own * dot(normal, normal):
            return True
    return False


@merged
def _evaluate_three(candidate, plane, threshold, tolerance):
    """Evaluate three contacts; see `evaluate`."""
    normals, radii = candidate.normals, candidate.radii
    # The elevation of normals rejects most candidates, and needs no projection.
    if _any_exceeds_elevation(candidate, threshold) or not (
        set_contact_plane(candidate.points, plane)
    ):
        return math.inf
    for i in range(3):
        set_normal(normals[i], radii[i], i, plane)
    if not (set_cones(threshold, plane) and cones_force_closed(plane)):
        return math.inf
    # Below the steepest elevation, at least one cone does not intersect the plane.
    low = 0.0
    for i in range(3):
        low = max(low, arc_sine(abs(dot(plane.frame[2], normals[i]))) + radii[i])
    return critical_of_normals(plane, min(low, threshold), threshold, tolerance)


@merged
def _force_part(points, i, u):
    """Force part of a direction at contact i: u_f + u_tau x p, with p from the first contact."""
    x, y, z = difference(points[i], points[0])
    return (
        u[0] + u[4] * z - u[5] * y,
        u[1] + u[5] * x - u[3] * z,
        u[2] + u[3] * y - u[4] * x,
    )


@merged
def _separates(candidate, i, u, sine):
    """Whether a direction separates a contact's forces or has no force part there."""
    force = _force_part(candidate.points, i, u)
    size = norm(force)
    return not size > 0.0 or -dot(candidate.normals[i], force) >= sine * size


@merged
def _is_separated(candidate, hull, n):
    """Whether a stored direction separates the candidate; if so, it is moved to the front."""
    directions = hull.directions
    for d in range(hull.direction_use[0]):
        u, i = directions[d], 0
        while i < n and _separates(candidate, i, u, hull.sines[i]):
            i += 1
        if i == n:
            # Move a successful direction to the front: the next candidates are similar.
            for k in range(6):
                last = directions[0, k]
                directions[0, k] = directions[d, k]
                directions[d, k] = last
            return True
    return False


@merged
def _write_axes(candidate, n, all_axes):
    """Write the wrenches of the normals and tangents, with moments about the first contact."""
    points, normals = candidate.points, candidate.normals
    for i in range(n):
        arm, normal = difference(points[i], points[0]), triple(normals[i], 0)
        nx, ny, nz = normal
        # Tangents from the cross product with z, or with x where the normal is close to z.
        if abs(nz) < 0.9:
            size = 1.0 / math.sqrt(nx * nx + ny * ny)
            tangent = (-ny * size, nx * size, 0.0)
        else:
            size = 1.0 / math.sqrt(ny * ny + nz * nz)
            tangent = (0.0, -nz * size, ny * size)
        forces = (normal, tangent, cross(normal, tangent))
        for j in range(3):
            torque = cross(arm, forces[j])
            for k in range(3):
                all_axes[i, j, k], all_axes[i, j, 3 + k] = forces[j][k], torque[k]


@merged
def _store_direction(directions, use, u):
    """Store a separating direction at the front, in place of the oldest one."""
    row = use[1]
    for k in range(6):
        directions[row, k] = directions[0, k]
        directions[0, k] = u[k]
    use[0] = max(use[0], row + 1)
    use[1] = row + 1 if row + 1 < MAX_DIRECTIONS else 1


@merged
def _hull_force_closed(candidate, hull, n, angle):
    """Test for closure at a friction angle with a hull, and store the separating direction."""
    axes, cones, polytope = hull.axes, hull.cones, hull.polytope
    _write_axes(candidate, n, axes)
    # Unit forces on the rim of circular cones.
    for i in range(n):
        own = angle - candidate.radii[i]
        cones[i, 0], cones[i, 1] = math.cos(own), math.sin(own)
    spherical, soft = True, False
    space = WrenchSpace(TOTAL, spherical, soft, axes[:n], cones[:n], 1)
    _, lower, _, _, facets = grow(space, SIX, hull.metric, None, AROUND_ORIGIN, SIGN, polytope)
    if facets > 0 and lower > ROUNDING:
        return True
    _store_direction(hull.directions, hull.direction_use, polytope.vectors[16])
    return False


@merged
def _proven_angle(candidate, direction, n):
    """Lower bound of the critical angle [rad] from the last separating direction."""
    least = RIGHT_ANGLE
    for i in range(n):
        force = _force_part(candidate.points, i, direction)
        size = norm(force)
        if size > 0.0:
            sine = -dot(candidate.normals[i], force) / size
            least = min(least, max(arc_sine(sine), 0.0) + candidate.radii[i])
    return least


@merged
def _evaluate_by_hulls(candidate, hull, n, threshold, tolerance):
    """Evaluate more than three contacts; see `evaluate`.

    The first test and the bisection share one loop because each call of the growing hull takes as
    long to compile as the hull.
    """
    low, high, tested = 0.0, math.inf, threshold
    for i in range(n):
        low = max(low, candidate.radii[i])
        hull.sines[i] = math.sin(threshold - candidate.radii[i])
    if low >= threshold or _is_separated(candidate, hull, n):
        return math.inf
    while high - low > tolerance:
        if _hull_force_closed(candidate, hull, n, tested):
            high = tested
        elif high == math.inf:
            return math.inf
        else:  # the separating direction may raise the lower end beyond the middle
            low = max(tested, min(_proven_angle(candidate, hull.directions[0], n), high))
        tested = 0.5 * (low + high)
    return high


@part
def evaluate(candidate, plane, hull, n, threshold, tolerance):
    """Find a grasp's critical friction angle over its worst normals, if below a threshold.

    Args:
        candidate: `Candidate`; no two contacts coincide.
        plane: `Plane`, for three contacts.
        hull: `HullScratch`, or None for three contacts, for which no hull is compiled.
        n: Number of contacts, at least 3.
        threshold: Friction angle [rad] at which the grasp must be force-closed, at most pi / 2.
        tolerance: Width [rad] of the bracket whose upper end is returned.

    Returns:
        The angle; inf if the grasp is not force-closed at the threshold. Three collinear contacts
        never are.
    """
    if hull is None:
        return _evaluate_three(candidate, plane, threshold, tolerance)
    return _evaluate_by_hulls(candidate, hull, n, threshold, tolerance)


NO_CONTACT = -1
"""Element or point of a finger that has no contact."""


class CandidatePoints(NamedTuple):
    """Points at which the other fingers are placed.

    First come points for all vertices, spread over the surface so that any number of the first ones
    is evenly spread; then points that belong to one vertex each.
    """

    common_count: int
    """Number of points for all vertices."""
    points: Floats2
    """Positions (P, 3)."""
    elements: Ints1
    """Face or vertex of each point (P,)."""
    weights: Floats2
    """Barycentric coordinates (P, 3)."""
    normals: FixedFloats2
    """Inward unit normals (P, 3); unused where contacts are vertices."""
    own: Ints1
    """The point that belongs to each vertex; NO_CONTACT if none (V,)."""


class ContactDomain(NamedTuple):
    """The surface on which fingers are placed, with its normals and neighbourhoods."""

    surface: Surface
    sets: ContactNormals
    adjacent_faces: Ints2
    """Face across the edge opposite each corner; -1 for none or several (F, 3)."""
    centres: FixedFloats2
    """Centre of each vertex's set of normals (V, 3)."""
    radii: FixedFloats1
    """Largest angle from the centre to a normal [rad]; negative if there is no normal (V,)."""
    neighbour_start: Ints1
    """First neighbour of each vertex in `neighbours` (V + 1,)."""
    neighbours: Ints1
    """Vertices around each vertex; for contacts on faces also those around these, and itself."""
    on_vertices: bool
    """Whether contacts are vertices; an element is then a vertex, otherwise a face."""
    candidates: CandidatePoints


class SearchLimits(NamedTuple):
    """Conditions on grasps and settings of the search; lengths as in `ContactDomain`."""

    min_distance: float
    """Smallest distance between two contacts."""
    max_distance: float
    """Largest distance between two contacts."""
    max_angle: float
    """Largest critical angle that counts [rad]."""
    tolerance: float
    """Width of the bracket of a critical angle [rad]."""
    margin: float
    """Smallest improvement of a critical angle that counts [rad]."""
    target: float
    """Critical angle below which a grasp is not improved further [rad]."""
    points_per_vertex: int
    """Number of candidate points that are paired at each vertex."""
    edge_length: float
    """Mean edge length."""
    shortest_step: float
    """Step length below which a refinement ends."""


@merged
def set_vertex_contact(i, vertex, domain, candidate):
    """Place contact i of a candidate at a vertex; return whether the vertex has a normal."""
    candidate.radii[i] = domain.radii[vertex] + turn_at_vertex(vertex, domain.surface.turns)
    copy(domain.surface.points[vertex], candidate.points[i])
    copy(domain.centres[vertex], candidate.normals[i])
    return domain.radii[vertex] >= 0.0


@merged
def set_face_contact(i, face, weights, domain, candidate, face_normals):
    """Place contact i of a candidate on a face; return whether the surface is smooth there."""
    weights = triple(weights, 0)
    count, vertex = write_normals(face, weights, domain.surface, domain.sets, face_normals)
    candidate.radii[i] = turn_on_face(face, weights, domain.surface.turns)
    copy(face_normals[0], candidate.normals[i])
    copy(point_on_face(face, weights, domain.surface), candidate.points[i])
    return count == 1 and vertex < 0


@merged
def set_contact(i, element, weights, domain, workspace):
    """Place contact i of a candidate on an element; return whether a finger may stay there."""
    if domain.on_vertices:
        return set_vertex_contact(i, element, domain, workspace.candidate)
    return set_face_contact(
        i, element, weights, domain, workspace.candidate, workspace.face_normals
    )


@merged
def set_point_contact(i, point, domain, candidate):
    """Place contact i of a candidate at a candidate point; return whether it may stay there."""
    if domain.on_vertices:
        return set_vertex_contact(i, domain.candidates.elements[point], domain, candidate)
    # Points are precomputed to keep interpolation and crease tests out of the innermost loops.
    element, weights = domain.candidates.elements[point], domain.candidates.weights[point]
    candidate.radii[i] = turn_on_face(element, weights, domain.surface.turns)
    copy(domain.candidates.points[point], candidate.points[i])
    copy(domain.candidates.normals[point], candidate.normals[i])
    return True


@merged
def is_allowed(one, other, limits):
    """Whether the distance between two contacts is within the limits."""
    square = squared_distance(one, other)
    smallest, largest = limits.min_distance, limits.max_distance
    return smallest * smallest <= square <= largest * largest


@merged
def distances_allowed(candidate, i, n, limits):
    """Whether the distances of contact i to the others of the first n are within the limits."""
    for j in range(n):
        if j != i and not is_allowed(candidate.points[i], candidate.points[j], limits):
            return False
    return True


STARTS = 3
"""Number of a vertex's grasps, without a common candidate point, that are refined."""


class BestGrasps(NamedTuple):
    """The best grasps so far, one row per vertex; updated in place."""

    angles: Floats1
    """Critical angles [rad], inf for none (V,)."""
    elements: Ints2
    """Face or vertex of every other finger; NO_CONTACT if there is no grasp (V, n - 1)."""
    weights: Floats3
    """Barycentric coordinates on the faces (V, n - 1, 3)."""
    stages: Ints1
    """Stage of the search in which each grasp was found (V,)."""


class SearchWorkspace(NamedTuple):
    """Scratch arrays for one thread.

    The scratch of `evaluate` is passed separately: LLVM splits every tuple that a kernel reads into
    its parts, which is most of its time for kernels with many arrays.
    """

    candidate: Candidate
    face_normals: Floats2
    """Normals at a surface point (2, 3)."""
    reachable: Ints1
    """Candidate points at allowed distances from the vertex (common_count + 1,)."""
    angles: Floats1
    """Critical angles of the starts [rad] (STARTS,)."""
    start_points: Ints2
    """Candidate points of their second and third fingers (STARTS, 2)."""
    elements: Ints2
    """Faces or vertices of the fingers: row 0 the current grasp, row 1 its variation (2, n)."""
    weights: Floats3
    """Barycentric coordinates of the fingers (2, n, 3)."""
    residuals: Floats2
    """Derivatives of the three contacts' residuals of balance, and the residuals (5, 4)."""
    equations: Floats2
    """Linear equations for a step, with their right sides (4, 5)."""
    random_state: UInt64s1
    """State of the random number generator (1,)."""
    evaluated: Ints1
    """Number of candidate grasps evaluated so far (1,)."""


def make_best_grasps(vertices: int, others: int) -> BestGrasps:
    """Allocate empty grasps with `others` fingers besides the first."""
    return BestGrasps(
        angles=np.full(vertices, math.inf),
        elements=np.full((vertices, others), NO_CONTACT, dtype=np.int64),
        weights=np.zeros((vertices, others, 3)),
        stages=np.zeros(vertices, dtype=np.int64),
    )


def make_search_workspace(fingers: int, common_count: int) -> SearchWorkspace:
    """Allocate scratch arrays for a number of fingers and of candidate points."""
    return SearchWorkspace(
        candidate=make_candidate(fingers),
        face_normals=np.zeros((2, 3)),
        reachable=np.zeros(common_count + 1, dtype=np.int64),
        angles=np.zeros(STARTS),
        start_points=np.zeros((STARTS, 2), dtype=np.int64),
        elements=np.zeros((2, fingers), dtype=np.int64),
        weights=np.zeros((2, fingers, 3)),
        residuals=np.zeros((5, 4)),
        equations=np.zeros((4, 5)),
        random_state=np.zeros(1, dtype=np.uint64),
        evaluated=np.zeros(1, dtype=np.int64),
    )


@merged
def set_current(j, domain, workspace):
    """Place contact j of the candidate as in the current grasp; return as `set_contact`."""
    return set_contact(j, workspace.elements[0, j], workspace.weights[0, j], domain, workspace)


@merged
def walk_finger(j, angle, length, domain, workspace):
    """Vary the current grasp by a straight walk of finger j; return as `set_contact`."""
    elements, weights, surface = workspace.elements, workspace.weights, domain.surface
    copy(weights[0, j], weights[1, j])
    elements[1, j] = walk(
        elements[0, j], weights[1, j], angle, length,
        surface.points, surface.faces, domain.adjacent_faces,
    )  # fmt: skip
    return set_contact(j, elements[1, j], weights[1, j], domain, workspace)


@merged
def keep_or_undo(keep, moved, n, domain, workspace):
    """Make the variation the current grasp, or reset the candidate to the current grasp.

    Args:
        keep: Whether the variation is better.
        moved: The finger that was moved; 0 for all.
        n: Number of contacts.
        domain: `ContactDomain`.
        workspace: `SearchWorkspace`.
    """
    for j in range(1, n):
        if moved in (0, j):
            if keep:
                workspace.elements[0, j] = workspace.elements[1, j]
                copy(workspace.weights[1, j], workspace.weights[0, j])
            else:
                set_current(j, domain, workspace)


@merged
def evaluate_if_allowed(fits, n, threshold, limits, workspace, plane, hull):
    """Evaluate the candidate if all its fingers fit and its distances are within the limits."""
    for j in range(1, n):  # with contacts 0 to j - 1, so each pair once
        fits = fits and distances_allowed(workspace.candidate, j, j, limits)
    workspace.evaluated[0] += fits
    if not fits or threshold <= 0.0:
        return math.inf
    return evaluate(workspace.candidate, plane, hull, n, threshold, limits.tolerance)


@merged
def load_grasp(v, n, grasps, domain, workspace):
    """Make the best grasp of a vertex so far the current one; return its critical angle."""
    set_vertex_contact(0, v, domain, workspace.candidate)
    # The first contact is the vertex itself and is not stored.
    for j in range(1, n):
        workspace.elements[0, j] = grasps.elements[v, j - 1]
        copy(grasps.weights[v, j - 1], workspace.weights[0, j])
        set_current(j, domain, workspace)
    return grasps.angles[v]


@merged
def store_grasp(v, n, angle, stage, grasps, workspace):
    """Store the current grasp as the best of a vertex."""
    grasps.angles[v], grasps.stages[v] = angle, stage
    for j in range(1, n):
        grasps.elements[v, j - 1] = workspace.elements[0, j]
        copy(workspace.weights[0, j], grasps.weights[v, j - 1])


@merged
def set_finger(i, point, domain, workspace):
    """Move finger i of the current grasp to a candidate point."""
    workspace.elements[0, i] = domain.candidates.elements[point]
    copy(domain.candidates.weights[point], workspace.weights[0, i])
    set_point_contact(i, point, domain, workspace.candidate)
