"""Proofs that a grasp is force-closed, or is not, that rounding errors cannot invalidate.

**Force closure.** Forces strictly inside their friction cones whose wrenches sum up to zero prove
it. In floating point they never do: a residual w remains, which proves nothing where some force is
hardly larger. So the forces are corrected, and the correction that is still missing is bounded. Let
force i have the distance m_i from the border of its cone, and G_i map changes of it to wrenches.
Among all changes d_i with sum of G_i d_i = -w those with the least sum of |d_i|^2 / m_i^2 are

    d_i = -m_i^2 G_i^T y,    A y = w,    A = sum of m_i^2 G_i G_i^T,

and that least sum is w^T A^-1 w. Where its root, the *slack*, is below 1, every |d_i| < m_i: the
corrected forces exist, balance exactly and are strictly inside their cones. Each force is thus
compared with its own margin, so a force that is as small as the residual spoils the proof. The
rounding errors of w are bounded in each coordinate and added to the slack.

**No force closure.** A direction u of wrench space is a motion of the object, and separates a grasp
if at no contact a force of its friction cone has a positive component along the contact's velocity
g, and at some contact every force has a negative one. Two cases prove it in floating point.
Contacts that move need an angle between g and the cone that is 90 degrees or more, up to a rounding
error of the angle: then friction that is smaller by that angle surely does not suffice. Contacts
that the motion leaves stationary have no component at all, but only if they are exactly so: as
small a velocity of any direction would need its sign. So u is replaced by the nearest direction
that leaves them stationary, which exists where they are at one point or on one line.
"""

import math

from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.hull.support_functions import NO_TORSION, ROWS
from grasp3d._kernels.surface.vectors import clear6, copy6, dot6, remove_components, scale6

LARGEST_SLACK = 0.01
"""Slack up to which forces count as a proof. 1 would do in exact arithmetic; the exactly balanced
forces are then within a hundredth of the margins of those returned."""

NOISE = 4e-15
"""Rounding errors of the sum of wrenches whose forces' lengths sum to 1, relative to the largest
wrench: about twenty roundings of a double."""

SMALL_SLACK = 1e-7
"""Slack that need not be reduced."""

COARSE = 1e-9
"""Slack of rounding errors from which the factor of A is computed with more care."""

CANCELLED = 1e-8
"""Part of a diagonal element that must remain in the elimination of A."""

CORRECTIONS = 3
"""Most corrections of the forces."""

BALANCED_SQUARE = 1e-20
"""Square of a slack that needs no correction."""


@merged
def _largest_across_edges(rim, shrink, x, y):
    """Largest component of a vector orthogonal to an edge of a regular polygon, at least 0.

    Args:
        rim: Corners of the polygon, on the unit circle (m, 2).
        shrink: Distance of its edges from the centre.
        x: The vector.
        y: The vector.
    """
    largest, count = 0.0, rim.shape[0]
    for j in range(count):
        k = j + 1 if j + 1 < count else 0
        largest = max(largest, x * (rim[j, 0] + rim[k, 0]) + y * (rim[j, 1] + rim[k, 1]))
    return largest * (0.5 / shrink)


@merged
def _margin(space, i, forces):
    """Distance of a contact's force from the border of its cone, or less; 0 or less outside."""
    if space.kind == ROWS:
        return forces[i, 0]
    normal, tangential = space.cones[i, 0], space.cones[i, 1]
    if not tangential > 0.0:  # a ray, along which the force may change
        return forces[i, 0]
    pressing = forces[i, 0]
    weight = tangential * tangential
    if space.torsion != NO_TORSION:  # torsion takes its part of the normal force
        pressing -= abs(forces[i, 3])
        weight *= 2.0
    count = space.rim.shape[0]
    if count == 0:
        sideways = math.sqrt(forces[i, 1] * forces[i, 1] + forces[i, 2] * forces[i, 2])
        return (pressing * tangential - sideways * normal) / math.sqrt(weight + normal * normal)
    # The faces of a polygonal cone are nearest to its axis midway between two edges.
    shrink = math.cos(math.pi / count)
    length = math.sqrt(weight * shrink * shrink + normal * normal)
    sideways = math.sqrt(forces[i, 1] * forces[i, 1] + forces[i, 2] * forces[i, 2])
    least = (pressing * tangential * shrink - sideways * normal) / length
    if least > 0.0:  # inside the circular cone that all faces touch
        return least
    sideways = _largest_across_edges(space.rim, shrink, forces[i, 1], forces[i, 2])
    return (pressing * tangential * shrink - sideways * normal) / length


@merged
def _may_change(space, i, j):
    """Whether a contact's force may change along one of its axes."""
    if j == 0:
        return True
    if space.kind == ROWS:
        return False
    return space.cones[i, 1] > 0.0 and (j < 3 or space.torsion != NO_TORSION)


@merged
def _component(space, i, j, k):
    """Component k of the wrench of axis j of a contact, or of a given wrench."""
    return space.axes[0, k, i] if space.kind == ROWS else space.axes[i, j, k]


@merged
def _factorise(matrix, rank):
    """Replace the lower triangle by its Cholesky factor; returns whether it is surely definite."""
    for c in range(rank):
        for r in range(c, rank):
            value = matrix[r, c]
            for k in range(c):
                value -= matrix[r, k] * matrix[c, k]
            if r == c:
                if not value > CANCELLED * matrix[c, c]:
                    return False
                matrix[c, c] = math.sqrt(value)
            else:
                matrix[r, c] = value / matrix[c, c]
    return True


@merged
def _rotate_into(matrix, rank, row):
    """Add a row b to the factor of A, which becomes that of A + b b^T, by Givens rotations."""
    for c in range(rank):
        if row[c] == 0.0:
            continue
        size = math.sqrt(matrix[c, c] * matrix[c, c] + row[c] * row[c])
        cosine, sine = matrix[c, c] / size, row[c] / size
        matrix[c, c] = size
        for r in range(c + 1, rank):
            value = matrix[r, c]
            matrix[r, c] = cosine * value + sine * row[r]
            row[r] = cosine * row[r] - sine * value


@merged
def _write_factor(space, rank, forces, thorough, matrix, residual, row):
    """Write the residual w and the Cholesky factor of A.

    Args:
        space: As for `balance`.
        rank: As for `balance`.
        forces: As for `balance`.
        thorough: Whether the factor is computed by rotations, without A itself: its least
            eigenvalue is the square of the smallest margin, which is lost beside the largest below
            a relative size of 1e-8.
        matrix: Written (6, 6).
        residual: Written (6,).
        row: Scratch (6,).

    Returns:
        Whether all forces are inside their cones and A is definite.
    """
    for k in range(rank):
        residual[k] = 0.0
        for c in range(k + 1):
            matrix[k, c] = 0.0
    for i in range(forces.shape[0]):
        margin = _margin(space, i, forces)
        if not margin > 0.0:
            return False
        for j in range(forces.shape[1]):
            if not _may_change(space, i, j):
                continue
            for k in range(rank):
                component = _component(space, i, j, k)
                residual[k] += forces[i, j] * component
                row[k] = margin * component
            if thorough:
                _rotate_into(matrix, rank, row)
            else:
                for k in range(rank):
                    for c in range(k + 1):
                        matrix[k, c] += row[k] * row[c]
    if not thorough:
        return _factorise(matrix, rank)
    least = math.inf
    for k in range(rank):
        least = min(least, matrix[k, k])
    return least > 0.0


@merged
def _halfway(matrix, rank, x):
    """Solve L x = x for the lower triangle L; returns the square of the solution."""
    square = 0.0
    for r in range(rank):
        value = x[r]
        for k in range(r):
            value -= matrix[r, k] * x[k]
        x[r] = value / matrix[r, r]
        square += x[r] * x[r]
    return square


@merged
def _noise_slack(matrix, rank, extents, column):
    """Slack that rounding may add: errors e_k of w add at most the sum of e_k sqrt((A^-1)_kk)."""
    size = slack = 0.0
    for k in range(rank):
        size = max(size, extents[k])
    for k in range(rank):
        for c in range(rank):
            column[c] = 1.0 if c == k else 0.0
        slack += NOISE * size / extents[k] * math.sqrt(_halfway(matrix, rank, column))
    return slack


@merged
def _normalise(forces):
    """Scale forces so that their lengths sum to 1; returns whether that is possible."""
    total = 0.0
    for i in range(forces.shape[0]):
        total += math.sqrt(
            forces[i, 0] * forces[i, 0] + forces[i, 1] * forces[i, 1] + forces[i, 2] * forces[i, 2]
        )
    if not (total > 0.0 and math.isfinite(total)):
        return False
    for i in range(forces.shape[0]):
        for j in range(forces.shape[1]):
            forces[i, j] /= total
    return True


@merged
def clear_slack(space, rank, extents, radius, forces, residual):
    """Slack of forces where wrenches of all directions are known to be possible.

    Forces of a total of |w| / radius balance the residual w where the grasp wrench space contains a
    ball of that radius. They lie inside the cones, so that added to the others these stay inside.

    Args:
        space: `WrenchSpace` of kind TOTAL, of unit forces.
        rank: As for `balance`.
        extents: As for `balance`.
        radius: Radius of the ball in the wrench space.
        forces: As for `balance`, but only scaled.
        residual: Scratch (6,).

    Returns:
        As `balance`, though larger.
    """
    if not _normalise(forces):
        return math.inf
    least = math.inf
    clear6(residual)
    for i in range(forces.shape[0]):
        least = min(least, _margin(space, i, forces))
        for j in range(forces.shape[1]):
            if not _may_change(space, i, j):
                continue
            axis, force = space.axes[i, j], forces[i, j]
            for k in range(6):  # coordinates beyond the rank are 0
                residual[k] += force * axis[k]
    if not least > 0.0:
        return math.inf
    square, size = 0.0, 0.0
    for k in range(rank):
        square += residual[k] * residual[k] * extents[k] * extents[k]
        size = max(size, extents[k])
    return (math.sqrt(square) + NOISE * size) / (radius * least)


@part
def balance(space, rank, extents, forces, scratch):
    """Correct nearly balanced forces and bound what is missing.

    Args:
        space: `WrenchSpace`, not PER_FINGER, in coordinates of the span.
        rank: Number of those coordinates.
        extents: Size of a unit of each coordinate in the wrench space (6,).
        forces: Contact forces in the contacts' axes (n, 4), or the weights of given wrenches
            in the first column (n, 4); corrected, their lengths sum to 1.
        scratch: Shape (18, 8).

    Returns:
        The slack: the forces' distance from exactly balanced ones relative to their distances from
        the borders of the cones. Below 1 the grasp is force-closed; inf: no proof.
    """
    matrix, residual, solution, row = scratch[0:6], scratch[6], scratch[7], scratch[8]
    count, noise = forces.shape[0], math.inf
    if not _normalise(forces):
        return math.inf
    thorough, attempt = False, 0
    while True:
        definite = _write_factor(space, rank, forces, thorough, matrix, residual, row)
        if definite:
            noise = _noise_slack(matrix, rank, extents, solution)
        if not (definite and noise < COARSE) and not thorough:
            thorough = True
            continue
        if not definite:
            return math.inf
        for k in range(rank):
            solution[k] = residual[k]
        square = _halfway(matrix, rank, solution)
        if not square < 0.25:  # far from balanced: corrected forces may be far from these
            return math.inf
        if square <= BALANCED_SQUARE or attempt == CORRECTIONS:
            _normalise(forces)
            return math.sqrt(square) + noise
        attempt += 1
        for r in range(rank - 1, -1, -1):
            for k in range(r + 1, rank):
                solution[r] -= matrix[k, r] * solution[k]
            solution[r] /= matrix[r, r]
        for i in range(count):
            margin = _margin(space, i, forces)
            margin *= margin
            for j in range(forces.shape[1]):
                if not _may_change(space, i, j):
                    continue
                change = 0.0
                for k in range(rank):
                    change += _component(space, i, j, k) * solution[k]
                forces[i, j] -= margin * change


MOVING, STATIONARY, UNPROVEN = 0, 1, 2
"""Results of `separation`: separated, all contacts move; separated, some contacts do not (to be
relied on where these contacts are exactly at one point, or on one line); not proven."""

ANGLE = 1e-9
"""Angle by which friction may be smaller for the proof to hold [rad]."""

STATIONARY_SPEED = 1e-9
"""Velocity, relative to the longest wrench and for a unit direction, up to which a contact may be
stationary; more than that has a direction that is known to 1e-6."""

ROUNDING = 1e-15
"""Rounding error of a support function, relative to the longest wrench."""

CLEARLY_MOVING = 1e-6
"""Velocity from which a contact moves once others are stationary."""

INDEPENDENT = 1e-6
"""Part of a wrench orthogonal to others below which it adds no dimension."""


@merged
def _is_resisted(soft, j):
    """Whether a contact resists a motion along its axis: all but torsion do unless it is soft."""
    return soft or j != 3


@merged
def _speed(axes, soft, u):
    """Size of a contact's velocity, with its turning where it resists torsion."""
    square = 0.0
    for j in range(axes.shape[0]):
        if not _is_resisted(soft, j):
            continue
        z = dot6(axes[j], u)
        square += z * z
    return math.sqrt(square)


@merged
def _support(axes, cone, soft, rim, u):
    """Support function of a contact's cone of unit forces, not clipped at 0."""
    z0, z1, z2 = dot6(axes[0], u), dot6(axes[1], u), dot6(axes[2], u)
    tangent = math.sqrt(z1 * z1 + z2 * z2)
    sideways = tangent
    if rim.shape[0] > 0:
        sideways = -math.inf
        for j in range(rim.shape[0]):
            sideways = max(sideways, rim[j, 0] * z1 + rim[j, 1] * z2)
    support = cone[0] * z0 + cone[1] * sideways
    # Of a circular cone that contains the velocity the velocity itself is the farthest.
    if rim.shape[0] == 0 and z0 * cone[1] > tangent * cone[0]:
        support = math.sqrt(z0 * z0 + tangent * tangent)
    return max(support, z0 + abs(dot6(axes[3], u))) if soft else support


@merged
def _leave_stationary(axes, soft, slowest, scratch, u, v):
    """Write u without its components along all wrenches of the contacts that it hardly moves.

    Returns:
        Whether any motion remains.
    """
    basis, components, size = scratch[0:6], scratch[6], 0
    for i in range(axes.shape[0]):
        if _speed(axes[i], soft, u) > slowest:
            continue
        for j in range(axes.shape[1]):
            if not _is_resisted(soft, j):
                continue
            if size >= 6:
                return False
            row = basis[size]
            copy6(axes[i, j], row)
            before = dot6(row, row)
            remove_components(basis, size, row, components)
            remove_components(basis, size, row, components)
            square = dot6(row, row)
            if square > INDEPENDENT * INDEPENDENT * before:
                factor = 1.0 / math.sqrt(square)
                scale6(row, factor)
                size += 1
    copy6(u, v)
    remove_components(basis, size, v, components)
    remove_components(basis, size, v, components)
    square = dot6(v, v)
    if not square > 0.25:
        return False
    for k in range(6):
        v[k] /= math.sqrt(square)
    return True


@merged
def _clearly_separated(axes, cone, soft, slowest, u):
    """Whether a contact moves, and that clearly away from its circular cone; quickly decided."""
    z0, z1, z2 = dot6(axes[0], u), dot6(axes[1], u), dot6(axes[2], u)
    across = z1 * z1 + z2 * z2
    return (
        not soft
        and z0 < 0.0
        and z0 * z0 + across > slowest * slowest
        and across * (cone[1] * cone[1]) <= z0 * z0 * (cone[0] * cone[0])
        and cone[0] > 0.0
    )


@part
def separation(kind, soft, axes, cones, rim, largest, u, scratch):
    """Whether a direction proves that a grasp is not force-closed.

    Args:
        kind: As in `WrenchSpace`; given wrenches are not examined.
        soft: As in `WrenchSpace`.
        axes: Wrenches of the contacts' axes (n, 4, 6).
        cones: As in `WrenchSpace` (n, 2).
        rim: As in `WrenchSpace` (m, 2).
        largest: Length of the longest wrench.
        u: Unit direction (6,); replaced where contacts are left stationary.
        scratch: Shape (18, 8).

    Returns:
        MOVING, STATIONARY or UNPROVEN.
    """
    if kind == ROWS:
        return MOVING
    count, slowest, stationary = axes.shape[0], STATIONARY_SPEED * largest, 0
    for i in range(count):
        if _clearly_separated(axes[i], cones[i], soft, slowest, u):
            continue
        speed = _speed(axes[i], soft, u)
        if speed <= slowest:
            stationary += 1
        elif _support(axes[i], cones[i], soft, rim, u) > ANGLE * speed + ROUNDING * largest:
            return UNPROVEN
    if stationary == 0:
        return MOVING
    v = scratch[7]
    if stationary == count or not _leave_stationary(axes, soft, slowest, scratch, u, v):
        return UNPROVEN
    for i in range(count):
        if _speed(axes[i], soft, u) > slowest:
            speed = _speed(axes[i], soft, v)
            # What touches its cone's border here might gain a positive component by the change.
            if (
                speed <= CLEARLY_MOVING * largest
                or _support(axes[i], cones[i], soft, rim, v) > ANGLE * speed
            ):
                return UNPROVEN
    copy6(v, u)
    return STATIONARY
