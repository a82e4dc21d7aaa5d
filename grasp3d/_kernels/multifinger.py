"""Grasps of three fingers and more through a vertex: seeded, refined, shared with neighbours."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import inlined, scratch_kernel
from grasp3d._kernels.coplanar_contacts import lay_plane
from grasp3d._kernels.multifinger_contacts import NOWHERE, keeps_apart, put, put_site, put_vertex
from grasp3d._kernels.multifinger_evaluation import RIGHT, Trial, make_trial, settle
from grasp3d._kernels.surface_walks import random_share, walk

STARTS = 3
"""Grasps of a vertex, without a place in common, around which the search begins."""

MATES = 128
"""Places after it that a place is paired with: any so many are well spread, and the work grows with
the places, not with their square."""

LONGER, SHORTER = 1.6, 0.88
"""What a step of the search becomes when it led to a better grasp, and when it did not."""

ALONE = 0.5
"""Share of the steps that move one finger only."""

LAST_RESORT = 1e-12
"""Worth of a place with many normals for an idle finger, which takes nothing even there."""

MOST_HOPS = 8
"""Edges that a finger moves along at most, where fingers stand on vertices."""


class Hands(NamedTuple):
    """The best grasps so far, a row per vertex; written in place."""

    angles: npt.NDArray[np.float64]
    """Critical angles [rad]; inf: none (V,)."""
    numbers: npt.NDArray[np.int64]
    """Face, or vertex, of every other finger; NOWHERE: none (V, n - 1)."""
    weights: npt.NDArray[np.float64]
    """Barycentric coordinates (V, n - 1, 3)."""


class Bench(NamedTuple):
    """Scratch for one thread."""

    trial: Trial
    found: npt.NDArray[np.float64]
    """Normals at a place (2, 3)."""
    within: npt.NDArray[np.int64]
    """Places of the pool within reach of the vertex (spread + 1,)."""
    angles: npt.NDArray[np.float64]
    """Critical angles of the starts [rad] (STARTS,)."""
    sites: npt.NDArray[np.int64]
    """Their places in the pool (STARTS, 2)."""
    numbers: npt.NDArray[np.int64]
    """Faces or vertices of the fingers of the grasp at hand, then of the one tried (2, n)."""
    weights: npt.NDArray[np.float64]
    """Their barycentric coordinates (2, n, 3)."""
    state: npt.NDArray[np.uint64]
    """Of the random numbers (1,)."""
    settled: npt.NDArray[np.int64]
    """Candidates settled so far (1,)."""


def make_hands(vertices: int, others: int) -> Hands:
    """Allocate grasps of no vertex yet, with so many fingers besides the first."""
    return Hands(
        angles=np.full(vertices, math.inf),
        numbers=np.full((vertices, others), NOWHERE, dtype=np.int64),
        weights=np.zeros((vertices, others, 3)),
    )


def make_bench(fingers: int, normals: int, places: int) -> Bench:
    """Allocate scratch for so many fingers, normals of a contact, and places spread."""
    return Bench(
        trial=make_trial(fingers, normals),
        found=np.zeros((2, 3)),
        within=np.zeros(places + 1, dtype=np.int64),
        angles=np.zeros(STARTS),
        sites=np.zeros((STARTS, 2), dtype=np.int64),
        numbers=np.zeros((2, fingers), dtype=np.int64),
        weights=np.zeros((2, fingers, 3)),
        state=np.zeros(1, dtype=np.uint64),
        settled=np.zeros(1, dtype=np.int64),
    )


@inlined
def _off_plane(trial, i, sine, mx, my, mz):
    """Whether a contact with one normal is too steep on a plane with normal m of any length."""
    if trial.counts[i] != 1:
        return False
    normal = trial.normals[i, 0]
    along = normal[0] * mx + normal[1] * my + normal[2] * mz
    return along * along >= sine * sine * (mx * mx + my * my + mz * mz)


@inlined
def _steep(trial, sine):
    """Whether one of three contacts pushes too steeply on the plane through them."""
    p, q, r = trial.points[0], trial.points[1], trial.points[2]
    ax, ay, az = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    bx, by, bz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return (
        _off_plane(trial, 0, sine, mx, my, mz)
        or _off_plane(trial, 1, sine, mx, my, mz)
        or _off_plane(trial, 2, sine, mx, my, mz)
    )


@inlined
def _reached(v, own, most, ground, pool, rules, bench):
    """List at most so many places within reach of a vertex, its own first; returns how many."""
    count = 0
    points = ground.surface.points
    if own >= 0:
        bench.within[0] = own
        count = 1
    for s in range(pool.spread):
        if count > most:
            break
        square = 0.0
        for c in range(3):
            d = pool.points[s, c] - points[v, c]
            square += d * d
        if rules.low * rules.low <= square <= rules.high * rules.high:
            bench.within[count] = s
            count += 1
    return count


@inlined
def _remember(angle, one, two, bench):
    """Keep the best starts that have no place in common, in order."""
    angles, sites = bench.angles, bench.sites
    row = STARTS - 1
    for k in range(STARTS):
        shared = one in (sites[k, 0], sites[k, 1]) or two in (sites[k, 0], sites[k, 1])
        if angles[k] < math.inf and shared:
            if angle >= angles[k]:
                return
            row = k
            break
    if angle >= angles[row]:
        return
    while row > 0 and angle < angles[row - 1]:
        angles[row] = angles[row - 1]
        sites[row, 0], sites[row, 1] = sites[row - 1, 0], sites[row - 1, 1]
        row -= 1
    angles[row] = angle
    sites[row, 0], sites[row, 1] = one, two


@inlined
def _seed(count, n, ground, pool, rules, bench):
    """Try all pairs of places within reach of a vertex as its second and third finger."""
    trial = bench.trial
    for k in range(STARTS):
        bench.angles[k] = math.inf
    for a in range(count):
        one = bench.within[a]
        if not put_site(1, one, ground, pool, trial):
            continue
        last = count if a == 0 else min(count, a + 1 + MATES)
        for b in range(a + 1, last):
            two = bench.within[b]
            if not (put_site(2, two, ground, pool, trial) and keeps_apart(trial, 2, 2, rules)):
                continue
            bench.settled[0] += 1
            bar = min(bench.angles[STARTS - 1] - rules.margin, rules.limit)
            if bar > 0.0 and not _steep(trial, math.sin(bar)):
                angle = settle(trial, n, bar, rules.tolerance, rules.helping)
                if angle < math.inf:
                    _remember(angle, one, two, bench)


@inlined
def _any_pair(count, ground, pool, rules, bench):
    """Take the first two places within reach that fit, where any grasp counts."""
    trial = bench.trial
    for a in range(count):
        for b in range(a + 1, count):
            one, two = bench.within[a], bench.within[b]
            if bench.angles[0] == math.inf and (
                put_site(1, one, ground, pool, trial)
                and put_site(2, two, ground, pool, trial)
                and keeps_apart(trial, 2, 2, rules)
                and lay_plane(trial.points, trial.plane)
            ):
                bench.angles[0] = RIGHT
                bench.sites[0, 0], bench.sites[0, 1] = one, two


@inlined
def _take_up(v, n, hands, ground, bench):
    """Lay out the best grasp of a vertex so far; returns its critical angle."""
    put_vertex(0, v, ground, bench.trial)
    for j in range(1, n):
        bench.numbers[0, j] = hands.numbers[v, j - 1]
        for c in range(3):
            bench.weights[0, j, c] = hands.weights[v, j - 1, c]
        put(j, bench.numbers[0, j], bench.weights[0, j], ground, bench)
    return hands.angles[v]


@inlined
def _lay_down(v, n, angle, hands, bench):
    """Keep the grasp at hand as the best of a vertex."""
    hands.angles[v] = angle
    for j in range(1, n):
        hands.numbers[v, j - 1] = bench.numbers[0, j]
        for c in range(3):
            hands.weights[v, j - 1, c] = bench.weights[0, j, c]


@inlined
def _stand(i, site, ground, pool, bench):
    """Let finger i of the grasp at hand stand on a place of the pool."""
    bench.numbers[0, i] = pool.numbers[site]
    for c in range(3):
        bench.weights[0, i, c] = pool.weights[site, c]
    put_site(i, site, ground, pool, bench.trial)


@inlined
def _move(j, step, ground, rules, bench):
    """Move finger j of the grasp at hand some way and write where it is then."""
    numbers, weights, state = bench.numbers, bench.weights, bench.state
    length = 2.0 * step * random_share(state)
    if ground.on_vertices:
        vertex = numbers[0, j]
        hops = min(MOST_HOPS, 1 + int(length / rules.edge))
        for _ in range(hops):
            first, last = ground.around[vertex], ground.around[vertex + 1]
            if last > first:
                vertex = ground.beside[first + int(random_share(state) * (last - first))]
        numbers[1, j] = vertex
        return
    for c in range(3):
        weights[1, j, c] = weights[0, j, c]
    surface = ground.surface
    numbers[1, j] = walk(
        numbers[0, j], weights[1, j], 2.0 * math.pi * random_share(state), length,
        surface.points, surface.faces, ground.across,
    )  # fmt: skip


@inlined
def _refine(n, angle, step, rounds, ground, rules, bench):
    """Move the fingers of the grasp at hand about, ever less, and stay where it is better.

    An evolution strategy with success-based steps (Rechenberg 1973): the critical angle is the
    largest of several, so that moving one finger after the other would end in its creases.

    Returns:
        Its critical angle [rad].
    """
    trial = bench.trial
    for _ in range(rounds):
        if angle <= rules.enough or (step < rules.shortest and not ground.on_vertices):
            break
        only = 0
        if random_share(bench.state) < ALONE:
            only = 1 + int(random_share(bench.state) * (n - 1))
        fits = True
        for j in range(1, n):
            if only in (0, j):
                _move(j, step, ground, rules, bench)
                fits = put(j, bench.numbers[1, j], bench.weights[1, j], ground, bench) and fits
        for j in range(1, n):
            fits = fits and keeps_apart(trial, j, j, rules)
        bar = angle - rules.margin
        bench.settled[0] += fits
        found = math.inf
        if fits and bar > 0.0:
            found = settle(trial, n, bar, rules.tolerance, rules.helping)
        better = found < math.inf
        if better:
            angle = found
        step *= LONGER if better else SHORTER
        for j in range(1, n):
            if only in (0, j):
                if better:
                    bench.numbers[0, j] = bench.numbers[1, j]
                    for c in range(3):
                        bench.weights[0, j, c] = bench.weights[1, j, c]
                else:
                    put(j, bench.numbers[0, j], bench.weights[0, j], ground, bench)
    return angle


@inlined
def _better_site(i, n, angle, count, ground, pool, rules, bench):
    """Put finger i where it helps most of all places within reach: (site or NOWHERE, angle)."""
    trial, chosen = bench.trial, NOWHERE
    for s in range(count):
        site, bar = bench.within[s], angle - rules.margin
        if bar <= 0.0:
            break
        if not (put_site(i, site, ground, pool, trial) and keeps_apart(trial, i, n, rules)):
            continue
        bench.settled[0] += 1
        found = settle(trial, n, bar, rules.tolerance, rules.helping)
        if found < math.inf:
            chosen, angle = site, found
    return chosen, angle


@inlined
def _clear_site(i, n, count, ground, pool, rules, bench):
    """The place within reach that is farthest from the others, for a finger that is idle there."""
    trial, chosen, widest = bench.trial, NOWHERE, 0.0
    for s in range(count):
        site = bench.within[s]
        fits = put_site(i, site, ground, pool, trial)
        if not (trial.counts[i] > 0 and keeps_apart(trial, i, n, rules)):
            continue
        least = math.inf
        for j in range(n):
            if j != i:
                x = trial.points[i, 0] - trial.points[j, 0]
                y = trial.points[i, 1] - trial.points[j, 1]
                z = trial.points[i, 2] - trial.points[j, 2]
                least = min(least, x * x + y * y + z * z)
        least *= 1.0 if fits else LAST_RESORT
        if least > widest:
            chosen, widest = site, least
    return chosen


@inlined
def _exchange(n, added, angle, count, ground, pool, rules, bench):
    """Put one finger after the other where it helps most of all places within reach.

    Args:
        n: Fingers.
        added: Whether the last one has no place yet: it comes first, and is put somewhere.
        angle: Critical angle of the grasp without it [rad].
        count: Places within reach.
        ground: `Ground`.
        pool: `Pool`.
        rules: `Rules`.
        bench: `Bench`.

    Returns:
        The critical angle [rad]; inf where the added finger has no place.
    """
    for turn in range(1, n):
        i = turn
        if added:
            i = n - 1 if turn == 1 else turn - 1
        site, first = NOWHERE, added and turn == 1
        if angle > rules.enough:
            site, angle = _better_site(i, n, angle, count, ground, pool, rules, bench)
        if first and site == NOWHERE:
            site = _clear_site(i, n, count, ground, pool, rules, bench)
            if site == NOWHERE:
                return math.inf
        if site != NOWHERE:
            _stand(i, site, ground, pool, bench)
        elif angle > rules.enough:
            put(i, bench.numbers[0, i], bench.weights[0, i], ground, bench)
    return angle


@inlined
def _share(v, n, ground, rules, before, hands, bench):
    """Try the places that the neighbours had for their other fingers: (neighbour, angle)."""
    trial, angle, chosen = bench.trial, hands.angles[v], NOWHERE
    if angle <= rules.enough:
        return chosen, angle
    for k in range(ground.around[v], ground.around[v + 1]):
        other = ground.beside[k]
        if not before.angles[other] < math.inf:
            continue
        fits = True
        for j in range(1, n):
            number, weights = before.numbers[other, j - 1], before.weights[other, j - 1]
            fits = put(j, number, weights, ground, bench) and fits
        for j in range(1, n):
            fits = fits and keeps_apart(trial, j, j, rules)
        bench.settled[0] += fits
        bar = min(angle - rules.margin, rules.limit)
        if fits and bar > 0.0:
            found = settle(trial, n, bar, rules.tolerance, rules.helping)
            if found < math.inf:
                chosen, angle = other, found
    return chosen, angle


@inlined
def _shuffle(seed, v, stage, state):
    """Begin the random numbers of a vertex, the same whoever works on it and when."""
    state[0] = np.uint64(seed)
    for part in (v, stage):
        random_share(state)
        state[0] ^= np.uint64(part)
    random_share(state)


@inlined
def _begin(v, own, n, ground, pool, rules, before, bench):
    """Seed three fingers, or take up the grasp with one finger less: how many starts there are."""
    count = _reached(v, own, rules.candidates, ground, pool, rules, bench)
    if n == 3:
        _seed(count, n, ground, pool, rules, bench)
        if bench.angles[0] == math.inf and rules.limit >= RIGHT:
            _any_pair(count, ground, pool, rules, bench)
        return STARTS
    bench.angles[0] = math.inf
    if before.angles[v] < math.inf:
        bench.angles[0] = _take_up(v, n - 1, before, ground, bench)
    return 1


@scratch_kernel
def work_on_hands(
    stage, vertices, own, n, ground, pool, rules, seed, step, rounds, before, hands, bench
):
    """Search grasps of n fingers through vertices.

    Every start is refined. Of three fingers the best one's are then tried one by one at all places
    of the pool, and refined again; a fourth or fifth is first tried at the vertex's candidates. A
    grasp that closes still does so with one finger more, so none becomes worse.

    Args:
        stage: 0: begin, among all pairs of places where there are three fingers, from the grasps
            with one finger less where there are more; from 1 on: the rounds in which neighbours
            share theirs.
        vertices: Vertices (m,).
        own: For every vertex a place of the pool to begin with; NOWHERE: none (V,).
        n: Fingers, 3 or more.
        ground: `Ground`.
        pool: `Pool`.
        rules: `Rules`.
        seed: Of the random numbers.
        step: First step of the refinement.
        rounds: Its steps.
        before: `Hands`: those with one finger less, or as they were when the round began.
        hands: `Hands`; written.
        bench: `Bench`.
    """
    trial = bench.trial
    for v in vertices:
        if not put_vertex(0, v, ground, trial):
            continue
        trial.used[0] = trial.used[1] = 0
        _shuffle(seed, v, 16 * stage + n, bench.state)
        if stage > 0:
            other, bench.angles[0] = _share(v, n, ground, rules, before, hands, bench)
            if other == NOWHERE:
                continue
            _take_up(other, n, before, ground, bench)
            put_vertex(0, v, ground, trial)
            starts = 1
        else:
            starts = _begin(v, own[v], n, ground, pool, rules, before, bench)
        again = stage == 0 and n == 3
        for k in range(starts + again):
            last = again and k == starts
            if last:
                angle = _take_up(v, n, hands, ground, bench)
                if not rules.enough < angle < math.inf:
                    break
            else:
                angle = bench.angles[k]
                if angle == math.inf:
                    continue
                if again:
                    _stand(1, bench.sites[k, 0], ground, pool, bench)
                    _stand(2, bench.sites[k, 1], ground, pool, bench)
            if last or (stage == 0 and n > 3):
                most = pool.spread if last else rules.candidates
                count = _reached(v, own[v], most, ground, pool, rules, bench)
                angle = _exchange(n, not last, angle, count, ground, pool, rules, bench)
            if angle < math.inf:
                angle = _refine(n, angle, step, rounds, ground, rules, bench)
            if angle < hands.angles[v]:
                _lay_down(v, n, angle, hands, bench)
