"""Closing of a hand: its joints move together until links touch an object, or each other.

Overlaps of the links of a hand with each other.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Bools2, Floats1, Floats2, Floats3, Ints2, kernel, part
from grasp3d._kernels.hands.kinematics import compose, moved, moved_back, place_links, turned_back
from grasp3d._kernels.hands.link_shapes import COARSE, point_depth
from grasp3d._kernels.hands.touched_surface import least_distance
from grasp3d._kernels.hands.touching import shape_gap
from grasp3d._kernels.surface.vectors import copy, difference, squared_distance

OVERLAPS = 5e-4
"""Depth from which on two links meet, or, at the open preshape, are meant to overlap [m]."""


@part
def overlap(i, j, one, other, deepest, relative, shapes):
    """Depth of the deepest point of shape i in shape j, or another that is at least as deep.

    Where the boxes around them are apart, minus a lower bound of their distance instead.
    """
    kind, size, box, own = shapes.kinds[j], shapes.sizes[j], shapes.boxes[j], shapes.boxes[i]
    first_plane = shapes.first_plane[j]
    planes = shapes.planes[first_plane : min(first_plane + COARSE, shapes.first_plane[j + 1])]
    for c in range(3):
        copy(turned_back(other, (one[0, c], one[1, c], one[2, c])), relative[:, c])
    copy(moved_back(other, (one[0, 3], one[1, 3], one[2, 3])), relative[:, 3])
    away = difference(moved(relative, own), box)
    apart = -math.inf  # the boxes around both, along an axis of one of them
    for k in range(3):
        mine, its, along = own[3 + k], box[3 + k], 0.0
        for c in range(3):
            mine += abs(relative[c, k]) * box[3 + c]
            its += abs(relative[k, c]) * own[3 + c]
            along += relative[c, k] * away[c]
        apart = max(apart, abs(away[k]) - its, abs(along) - mine)
    if apart > 0.0:
        return -apart
    for k in range(shapes.first_sample[i], shapes.first_sample[i + 1]):
        p = difference(moved(relative, shapes.samples[k]), box)
        inside = min(box[3] - abs(p[0]), box[4] - abs(p[1]), box[5] - abs(p[2]))
        if inside > deepest:
            p = moved(relative, shapes.samples[k])
            deepest = max(deepest, min(inside, -point_depth(p, kind, size, box, planes)))
    return deepest


@kernel("Floats4, int, int, Ints2, LinkShapes, Floats1, Ints2")
def self_overlaps(frames, begin, end, allowed, shapes, depths, pairs):
    """Find the two links of each pose that overlap most.

    Args:
        frames: Frames of the links (k, L, 3, 4).
        begin: First pose.
        end: The one after the last.
        allowed: 1: the two links may overlap, or are not looked at (L, L).
        shapes: `LinkShapes`.
        depths: Written: how deep they overlap, 0: not at all (k,).
        pairs: Written: the links, -1: none (k, 2).
    """
    size = shapes.kinds.shape[0]
    poses = np.empty((size, 3, 4))
    middles, relative = np.empty((size, 3)), np.empty((3, 4))
    for pose in range(begin, end):
        for i in range(size):
            compose(frames[pose, shapes.links[i]], shapes.poses[i], poses[i])
            middles[i, 0], middles[i, 1], middles[i, 2] = moved(poses[i], shapes.boxes[i])
        depths[pose], pairs[pose, 0], pairs[pose, 1] = 0.0, -1, -1
        for i in range(size):
            for j in range(i + 1, size):
                one, other = shapes.links[i], shapes.links[j]
                if allowed[one, other] == 1:
                    continue
                square = 0.0
                for k in range(3):
                    square += (middles[i, k] - middles[j, k]) ** 2
                if square >= (shapes.boxes[i, 6] + shapes.boxes[j, 6]) ** 2:
                    continue
                depth = depths[pose]
                depth = overlap(i, j, poses[i], poses[j], depth, relative, shapes)
                if depth >= 0.0:
                    depth = overlap(j, i, poses[j], poses[i], depth, relative, shapes)
                if depth > depths[pose]:
                    depths[pose], pairs[pose, 0], pairs[pose, 1] = depth, one, other


TOUCHES = 5e-5
"""Gap, or depth, at which a link touches [m]."""

STEPS = 5000
"""Most steps of closing."""

LINKS_STEP = 2e-3
"""Step of a joint [rad or m] that is not halved further where links of the hand meet."""

JOINT_STEP = 0.1
"""Largest step of a joint [rad or m]."""

CREEP = 5e-4
"""Way of a shape [m] in a step beyond what its gap allows: a step that ends too deep is repeated,
shorter, and what it grazes in between is about half as deep at most."""

FAR = 0.03
"""Gap [m] that is measured no more exactly."""


class Closing(NamedTuple):
    """How a hand closes; p joints, m shapes."""

    speeds: Floats1
    """Of the joints (p,)."""
    limits: Floats2
    """(p, 2)."""
    reaches: Floats2
    """Largest distance of a shape's points from each joint's axis (m, p); 0: not moved."""
    most: Floats1
    """Steps of shapes with which no two pass through each other unseen [m] (m,)."""
    pairs: Ints2
    """Shapes of different links that are not to overlap (n, 2)."""


class ClosingScratch(NamedTuple):
    """Arrays of one thread; L links, m shapes, n pairs."""

    frames: Floats3
    """Frames of the links (L, 4, 4)."""
    placed: Floats3
    """Frames of two shapes, and of one in that of the other; two motions (5, 3, 4)."""
    joints: Floats2
    """Values that are tried, and speeds, 0: stopped (2, p)."""
    fastest: Floats1
    """Largest speed of each shape's points (m,)."""
    gaps: Floats2
    """Lower bounds of the gaps of the shapes, and those after the step that is tried (2, m)."""
    measured: Bools2
    """Whether they were measured at that posture (2, m)."""
    apart: Floats2
    """Lower bounds of the distances of pairs, and those after the step (2, n); inf: any."""


def make_closing_scratch(closing: Closing, links: int) -> ClosingScratch:
    """Allocate the arrays of one thread."""
    count, joints = closing.reaches.shape
    return ClosingScratch(
        np.zeros((links, 4, 4)), np.zeros((5, 3, 4)), np.zeros((2, joints)), np.zeros(count),
        np.zeros((2, count)), np.zeros((2, count), np.bool_), np.zeros((2, len(closing.pairs))),
    )  # fmt: skip


@part
def _least_gap(i, shapes, surface, own, scratch):
    """Rough lower bound of the signed distance of a shape from the object; its pose is written."""
    compose(own.frames[shapes.links[i]], shapes.poses[i], scratch.pose)
    return least_distance(moved(scratch.pose, shapes.boxes[i]), surface)[0] - shapes.boxes[i, 6]


@part
def _raise(i, row, least, shapes, surface, own, scratch):
    """Write a better bound of a shape's gap: a rough one above the least, else the gap itself."""
    gap = _least_gap(i, shapes, surface, own, scratch)
    own.measured[row, i] = gap <= least
    if gap <= least:
        gap = min(shape_gap(i, shapes.first_sample[i], FAR, shapes, surface, scratch), FAR)
    own.gaps[row, i] = gap


@part
def _apart(i, j, shapes, own):
    """Lower bound of the distance of two shapes, 0: they are near; negative: minus the overlap."""
    one, other, relative = own.placed[0], own.placed[1], own.placed[2]
    compose(own.frames[shapes.links[i]], shapes.poses[i], one)
    compose(own.frames[shapes.links[j]], shapes.poses[j], other)
    square = squared_distance(moved(one, shapes.boxes[i]), moved(other, shapes.boxes[j]))
    away = math.sqrt(square) - shapes.boxes[i, 6] - shapes.boxes[j, 6]
    if away > 0.0:
        return away
    depth = overlap(i, j, one, other, OVERLAPS, relative, shapes)
    if depth >= 0.0:
        depth = overlap(j, i, other, one, depth, relative, shapes)
    return -depth if depth < 0.0 or depth > OVERLAPS else 0.0


@part
def _begin(closing, shapes, surface, own, scratch):
    """Write the gaps and distances from which closing starts."""
    for i in range(shapes.kinds.shape[0]):
        own.gaps[0, i], own.measured[0, i] = math.inf, True
        for c in range(closing.speeds.shape[0]):
            if closing.speeds[c] != 0.0 and closing.reaches[i, c] > 0.0:
                _raise(i, 0, TOUCHES, shapes, surface, own, scratch)
                break
    pairs, links, apart = closing.pairs, shapes.links, own.apart[0]
    for n in range(pairs.shape[0]):
        apart[n] = _apart(pairs[n, 0], pairs[n, 1], shapes, own)
    for n in range(pairs.shape[0]):
        if apart[n] < -OVERLAPS:  # these links may go deeper, on their way out for instance
            for k in range(pairs.shape[0]):
                if (
                    links[pairs[k, 0]] == links[pairs[n, 0]]
                    and links[pairs[k, 1]] == links[pairs[n, 1]]
                ):
                    apart[k] = math.inf


@part
def _stop(i, j, closing, pace):
    """Stop the joints that move a shape (j < 0), or one of two alone; whether any was moving."""
    stopped = False
    for c in range(pace.shape[0]):
        moves = closing.reaches[i, c] > 0.0
        if j >= 0:
            moves = moves != (closing.reaches[j, c] > 0.0)
        if moves and pace[c] != 0.0:
            stopped, pace[c] = True, 0.0
    return stopped


@part
def _times(closing, shapes, surface, own, scratch):
    """How long the joints may move: safely, and up to where the step may have to be repeated.

    The gap of the shape that lets them move least is measured, if it is not yet.
    """
    pace, fastest, gaps, highest = own.joints[1], own.fastest, own.gaps[0], 0.0
    for c in range(pace.shape[0]):
        highest = max(highest, abs(pace[c]))
    if highest == 0.0:
        return 0.0, 0.0
    for i in range(fastest.shape[0]):
        fastest[i] = 0.0
        for c in range(pace.shape[0]):
            fastest[i] += abs(pace[c]) * closing.reaches[i, c]
    longest = JOINT_STEP / highest
    for n in range(closing.pairs.shape[0]):
        one, other = closing.pairs[n, 0], closing.pairs[n, 1]
        both = fastest[one] + fastest[other]
        if both > 0.0 and own.apart[0, n] < both * longest:
            seen = math.inf
            if fastest[one] > 0.0:
                seen = closing.most[one] / fastest[one]
            if fastest[other] > 0.0:
                seen = min(seen, closing.most[other] / fastest[other])
            longest = min(longest, max(own.apart[0, n] / both, seen))
    while True:
        safe, least, first = longest, longest, -1
        for i in range(gaps.shape[0]):
            speed, way = fastest[i], gaps[i] - 0.5 * TOUCHES
            if speed > 0.0:
                safe = min(safe, way / speed)
            if speed > 0.0 and least * speed > way + CREEP:
                least, first = (way + CREEP) / speed, i
        if first < 0 or own.measured[0, first]:
            break
        _raise(first, 0, gaps[first] + CREEP, shapes, surface, own, scratch)
    return safe, least


@part
def _meeting(time, closing, shapes, own):
    """The pair that meets after a step, -1: none; distances after it are written."""
    pace, reaches = own.joints[1], closing.reaches
    for n in range(closing.pairs.shape[0]):
        one, other = closing.pairs[n, 0], closing.pairs[n, 1]
        left = own.apart[0, n] - time * (own.fastest[one] + own.fastest[other])
        if left <= 0.0:
            left = _apart(one, other, shapes, own)
            if left < -OVERLAPS:
                for c in range(pace.shape[0]):
                    if pace[c] != 0.0 and (reaches[one, c] > 0.0) != (reaches[other, c] > 0.0):
                        return n
        own.apart[1, n] = max(left, 0.0)
    return -1


@part
def _share(time, shapes, surface, own, scratch):
    """Share of a step after which no shape is too deep, as foreseen; gaps after it are written."""
    share = 1.0
    for i in range(shapes.kinds.shape[0]):
        before, way = own.gaps[0, i], time * own.fastest[i]
        own.gaps[1, i], own.measured[1, i] = before - way, way == 0.0
        if way > 0.0 and before - way <= TOUCHES:
            _raise(i, 1, TOUCHES, shapes, surface, own, scratch)
            after = own.gaps[1, i]
            if after < -TOUCHES:
                share = min(share, 0.9, max(0.1, before / (before - after)))
    return share


@part
def _step(pose, values, cap, closing, chain, shapes, surface, own, scratch):
    """Move the joints on; returns the longest time of the next step, 0: all have stopped."""
    tried, pace, cap_after = own.joints[0], own.joints[1], 2.0 * cap
    for i in range(shapes.kinds.shape[0]):
        if own.gaps[0, i] <= TOUCHES:
            _stop(i, -1, closing, pace)
    safe, time = _times(closing, shapes, surface, own, scratch)
    if time == 0.0:
        return 0.0
    time = min(time, cap)
    while True:
        way = 0.0
        for c in range(pace.shape[0]):
            low, high = closing.limits[c, 0], closing.limits[c, 1]
            tried[c] = values[c]
            if pace[c] != 0.0:
                tried[c] = min(max(values[c] + time * pace[c], low), high)
            way = max(way, abs(tried[c] - values[c]))
        place_links(pose, tried, chain, own.placed[3], own.placed[4], own.frames)
        met = _meeting(time, closing, shapes, own)
        if met >= 0:
            if way <= LINKS_STEP:
                _stop(closing.pairs[met, 0], closing.pairs[met, 1], closing, pace)
                place_links(pose, values, chain, own.placed[3], own.placed[4], own.frames)
                return cap_after
            time *= 0.5
            cap_after = 2.0 * time
            continue
        share = _share(time, shapes, surface, own, scratch)
        if share == 1.0 or time <= safe:
            break
        time = max(safe, share * time)
    for c in range(pace.shape[0]):
        values[c] = tried[c]
        low, high = closing.limits[c, 0], closing.limits[c, 1]
        if (pace[c] > 0.0 and tried[c] >= high) or (pace[c] < 0.0 and tried[c] <= low):
            pace[c] = 0.0
    for i in range(own.gaps.shape[1]):
        own.gaps[0, i], own.measured[0, i] = own.gaps[1, i], own.measured[1, i]
    for n in range(own.apart.shape[1]):
        own.apart[0, n] = own.apart[1, n]
    return cap_after


@kernel(
    "Floats3, Floats2, int, int, Closing, Chain, LinkShapes, TouchedSurface, ClosingScratch, "
    "TouchScratch"
)
def close(poses, postures, begin, end, closing, chain, shapes, surface, own, scratch):
    """Close hands.

    All joints move at their speeds. For each shape a lower bound of its gap is kept, less the way
    that the shape may have gone; it is measured where the bound is used up. So it is with pairs.

    Args:
        poses: Hand's frame to that of the object [m] (k, 4, 4).
        postures: From which they close, and then the ones at which they stop (k, p).
        begin: First pose.
        end: The one after the last.
        closing: `Closing`.
        chain: `Chain`.
        shapes: `LinkShapes`.
        surface: `TouchedSurface`.
        own: `ClosingScratch`.
        scratch: `TouchScratch`.
    """
    for row in range(begin, end):
        pose, values, cap = poses[row], postures[row], math.inf
        for c in range(values.shape[0]):
            own.joints[1, c] = closing.speeds[c]
        place_links(pose, values, chain, own.placed[3], own.placed[4], own.frames)
        _begin(closing, shapes, surface, own, scratch)
        for _ in range(STEPS):
            cap = _step(pose, values, cap, closing, chain, shapes, surface, own, scratch)
            if cap == 0.0:
                break
