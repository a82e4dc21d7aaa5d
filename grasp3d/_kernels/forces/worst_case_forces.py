"""Forces and moments that contacts can apply whichever their normals are, within a tilt.

A hard contact can apply what lies in all its cones, the cone of half-angle beta - a; bounded by its
normal component at any of the normals, n' . f <= 1, a force at an angle psi from the given normal
may be as long as 1 / cos(max(0, psi - a)).

The torsional moment m n' of a soft finger turns with its normal n'. Two contacts, with the line d
from one to the other, at a distance L, keep it the same whatever their normals are: with m =
M / (n' . d) its part along d is M; the rest is M times a vector across d, known to within a disc of
radius R = (tan(phi + a) - tan(phi - a)) / 2, phi the angle between d and the given normal. A couple
of forces c and -c across d cancels what is not known, |c| <= C = (M_1 R_1 + M_2 R_2) / L. A force f
and that moment are applied at every normal if, with m = M / cos(phi + a) the largest moment,

    n' . (f + c) >= |(cos beta (f + c), sin beta m / e)|,

which is the limit surface (f_t / mu)^2 + (m / e)^2 <= f_n^2 of Howe & Cutkosky (IJRR 1996). The
left side is at least |f| cos(psi + a) - X, where X bounds what c takes away; the right side grows
with |f + c|. This is certain for all normals, and somewhat less than what they have in common.
"""

import math

from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.hull.tilted_forces import COLUMNS, MODES
from grasp3d._kernels.surface.vectors import angle_between, difference, dot, norm

HALVINGS = 26
"""Steps of bisections, whose result is on the safe side."""

CLEAR = 1.0 - 1e-9
"""Part of the largest moment that is taken, so that rounding errors do not matter."""

ALIGNED = 1e-9
"""Sine of an angle from the line that is a rounding error."""


@merged
def _couple(i, share, tilts, phi, moments, distance):
    """Length of the couple's forces, and what they take away from n' . f of a contact."""
    own = other = 0.0
    for j in range(2):
        low, high = math.tan(phi[j] - tilts[j]), math.tan(phi[j] + tilts[j])
        size = share * moments[j] * 0.5 * (high - low) / distance
        if j == i:
            # The couple that a normal's own turn needs is across that turn.
            own = size * min(0.5 * abs(high + low), math.sin(phi[j] + tilts[j]))
            total = size
        else:
            other = size
    lost = own + other * math.sin(phi[i] + tilts[i])
    return total + other, lost


@merged
def _aside(phi, psi):
    """Largest sine of the angle between the line and a force at an angle psi from the normal."""
    return 1.0 if phi + psi >= 0.5 * math.pi else math.sin(phi + psi)


@merged
def _holds(beta, tilt, phi, share, couple, lost, psi, length):
    """Whether a force of that length at an angle psi is in all limit surfaces."""
    square = length * length + couple * (2.0 * length * _aside(phi, psi) + couple)
    needed = math.sqrt(math.cos(beta) ** 2 * square + (math.sin(beta) * share) ** 2)
    return length * math.cos(psi + tilt) - lost >= needed


@merged
def _longest(spherical, tilt, phi, couple, lost, psi):
    """The longest force at an angle psi whose bound no normal and no couple exceeds."""
    if spherical:
        across = couple * _aside(phi, psi)
        return math.sqrt(max(1.0 - couple * couple + across * across, 0.0)) - across
    return (1.0 - lost) / math.cos(max(0.0, psi - tilt))


@merged
def _write_hard(spherical, beta, tilt, row):
    """Write the level without moments of one contact."""
    for k in range(COLUMNS):
        row[k] = 0.0
    if tilt > beta:
        return  # no force is in all its cones
    psi = beta - tilt
    ball = psi if spherical else min(psi, tilt)
    longest = 1.0 if spherical else 1.0 / math.cos(max(0.0, psi - tilt))
    row[2], row[3], row[4] = 1.0, math.cos(ball), math.sin(ball)
    row[5], row[6] = longest * math.cos(psi), longest * math.sin(psi)


@merged
def _possible_share(spherical, share, angles, tilts, phi, moments, distance):
    """Whether both contacts can apply that share of their moments."""
    for i in range(2):
        part = share if moments[i] > 0.0 else 0.0
        couple, lost = _couple(i, share, tilts, phi, moments, distance)
        if couple >= 1.0 or lost >= 1.0:
            return False
        length = _longest(spherical, tilts[i], phi[i], couple, lost, 0.0)
        if not _holds(angles[i], tilts[i], phi[i], part, couple, lost, 0.0, length):
            return False
    return True


@merged
def _write_mode(spherical, i, share, most, angles, tilts, phi, moments, distance, row):
    """Write a mode of one contact: a share of its moment, on the level of the largest share."""
    beta, tilt, part = angles[i], tilts[i], share if moments[i] > 0.0 else 0.0
    couple, lost = _couple(i, most, tilts, phi, moments, distance)
    straight = _longest(spherical, tilt, phi[i], couple, lost, 0.0)
    corner, above = 0.0, beta - tilt
    apex, below = straight, 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (corner + above)
        length = _longest(spherical, tilt, phi[i], couple, lost, middle)
        if _holds(beta, tilt, phi[i], part, couple, lost, middle, length):
            corner = middle
        else:
            above = middle
        middle = 0.5 * (apex + below)
        if _holds(beta, tilt, phi[i], part, couple, lost, 0.0, middle):
            apex = middle
        else:
            below = middle
    length = _longest(spherical, tilt, phi[i], couple, lost, corner)
    radius, ball = length, corner
    if not spherical:
        radius, ball, above = straight, 0.0, min(corner, tilt)
        for _ in range(HALVINGS):
            middle = 0.5 * (ball + above)
            if _holds(beta, tilt, phi[i], part, couple, lost, middle, radius):
                ball = middle
            else:
                above = middle
    row[0], row[1] = part, apex
    row[2], row[3], row[4] = radius, math.cos(ball), math.sin(ball)
    row[5], row[6] = length * math.cos(corner), length * math.sin(corner)


@merged
def _write_axis(line, normal, phi, tilt, moment, axis):
    """Write the middle of the moments with the part `moment` along the line."""
    sense = math.copysign(1.0, dot(line, normal))
    aside = 0.5 * (math.tan(phi + tilt) + math.tan(phi - tilt))
    sine = math.sin(phi)
    for k in range(3):
        along = line[k] / norm(line)
        across = (sense * normal[k] - math.cos(phi) * along) / sine if sine > ALIGNED else 0.0
        axis[k] = moment * (along + aside * across)


@scratch_kernel(
    "bool, FixedFloats3, FixedFloats3, FixedFloats2, Floats2, Floats2, Floats1, Floats1, Floats3, "
    "Floats3"
)
def write_worst_case_forces(
    spherical, points, normals, radii, angles, tilts, phi, moments, cones, axes
):
    """Write the levels of what contacts apply in the worst case; see `tilted_forces`.

    Args:
        spherical: Whether lengths of forces are bounded, instead of normal components.
        points: Contacts (b, n, 3).
        normals: Given unit normals (b, n, 3).
        radii: Torsion radii (b, n).
        angles: Half-angles of the friction cones, below pi/2 (b, n).
        tilts: Largest tilts, below pi/2 (b, n).
        phi: Scratch (2,).
        moments: Scratch (2,).
        cones: Written, the modes of each level (b, n, k MODES COLUMNS), the first of which is that
            of hard contacts; or only that (b, n, COLUMNS).
        axes: Written, the moments of the fourth axis (b, n, 3).
    """
    size, count = tilts.shape
    levels = cones.shape[2] // (MODES * COLUMNS)  # 0: one of one mode
    for g in range(size):
        for i in range(count):
            for k in range(COLUMNS, cones.shape[2]):
                cones[g, i, k] = 0.0
            for k in range(3):
                axes[g, i, k] = 0.0
            _write_hard(spherical, angles[g, i], tilts[g, i], cones[g, i])
        if count != 2 or levels < 2:
            continue
        distance = norm(difference(points[g, 1], points[g, 0]))
        usable = distance > 0.0
        for i in range(2):
            line = difference(points[g, 1], points[g, 0])
            angle = angle_between(line, normals[g, i]) if usable else 0.0
            phi[i] = min(angle, math.pi - angle)
            moments[i] = radii[g, i] * math.cos(min(phi[i] + tilts[g, i], 0.5 * math.pi))
            usable = usable and phi[i] + tilts[g, i] < 0.5 * math.pi
            usable = usable and tilts[g, i] < angles[g, i]
        if not usable or moments[0] + moments[1] <= 0.0:
            continue
        own = angles[g], tilts[g], phi, moments, distance
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            if _possible_share(spherical, middle, *own):
                low = middle
            else:
                high = middle
        for i in range(2):
            _write_axis(line, normals[g, i], phi[i], tilts[g, i], moments[i], axes[g, i])
            for level in range(1, levels):
                most = low * CLEAR * level / (levels - 1)
                for mode in range(MODES):
                    share = most * math.sin(0.5 * math.pi * mode / (MODES - 1))
                    first = (level * MODES + mode) * COLUMNS
                    row = cones[g, i, first : first + COLUMNS]
                    _write_mode(spherical, i, share, most, *own, row)
