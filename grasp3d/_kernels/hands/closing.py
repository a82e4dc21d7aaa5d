"""Close a hand: its joints move together until links touch an object or each other.

Also find overlaps between the links of a hand.
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
"""Depth [m] at which two links collide; those that overlap deeper when open are meant to do so."""


@part
def overlap(i, j, one, other, deepest, relative, shapes):
    """Depth of the deepest point of shape i in shape j, or `deepest` if that is larger.

    Where the boxes around them are apart, return minus a lower bound of their distance.
    """
    kind, size, box, own = shapes.kinds[j], shapes.sizes[j], shapes.boxes[j], shapes.boxes[i]
    first_plane = shapes.first_plane[j]
    planes = shapes.planes[first_plane : min(first_plane + COARSE, shapes.first_plane[j + 1])]
    for c in range(3):
        copy(turned_back(other, (one[0, c], one[1, c], one[2, c])), relative[:, c])
    copy(moved_back(other, (one[0, 3], one[1, 3], one[2, 3])), relative[:, 3])
    away = difference(moved(relative, own), box)
    apart = -math.inf  # gap between the boxes along an axis of one of them
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
    """Find the two links that overlap most in each pose.

    Args:
        frames: Frames of the links (k, L, 3, 4).
        begin: First pose.
        end: One past the last pose.
        allowed: 1 for links that may overlap or are not examined (L, L).
        shapes: `LinkShapes`.
        depths: Written, depth of the overlap, 0 for none (k,).
        pairs: Written, the two links, -1 for none (k, 2).
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
"""Gap or depth at which a link counts as touching [m]."""

STEPS = 5000
"""Most steps while closing."""

LINKS_STEP = 2e-3
"""Step of a joint [rad or m] that is not halved further where links of the hand collide."""

JOINT_STEP = 0.1
"""Largest step of a joint [rad or m]."""

CREEP = 5e-4
"""Distance [m] that a shape may move in a step beyond its gap. A step that ends too deep is
repeated with a shorter one; what the shape grazes in between is at most about half as deep."""

FAR = 0.03
"""Gap [m] beyond which gaps are not measured exactly."""


class Closing(NamedTuple):
    """How a hand closes; p joints, m shapes."""

    speeds: Floats1
    """Speeds of the joints (p,)."""
    limits: Floats2
    """Limits of the joints (p, 2)."""
    reaches: Floats2
    """Largest distance of a shape's points from each joint's axis (m, p); 0 if not moved."""
    most: Floats1
    """Longest step at which no shape passes through another unnoticed [m] (m,)."""
    pairs: Ints2
    """Shapes of different links that must not overlap (n, 2)."""


class ClosingScratch(NamedTuple):
    """Arrays of one thread; L links, m shapes, n pairs."""

    frames: Floats3
    """Frames of the links (L, 4, 4)."""
    placed: Floats3
    """Frames of two shapes, the frame of one in that of the other, and two motions (5, 3, 4)."""
    joints: Floats2
    """Joint values that are tried, and speeds, 0 for a stopped joint (2, p)."""
    fastest: Floats1
    """Largest speed of each shape's points (m,)."""
    gaps: Floats2
    """Lower bounds of the shapes' gaps, now and after the step that is tried (2, m)."""
    measured: Bools2
    """Whether each gap was measured at that posture (2, m)."""
    apart: Floats2
    """Lower bounds of the pairs' distances, now and after the step (2, n); inf if unrestricted."""


def make_closing_scratch(closing: Closing, links: int) -> ClosingScratch:
    """Allocate the arrays of one thread."""
    count, joints = closing.reaches.shape
    return ClosingScratch(
        np.zeros((links, 4, 4)), np.zeros((5, 3, 4)), np.zeros((2, joints)), np.zeros(count),
        np.zeros((2, count)), np.zeros((2, count), np.bool_), np.zeros((2, len(closing.pairs))),
    )  # fmt: skip


@part
def _least_gap(i, shapes, surface, own, scratch):
    """Rough lower bound of a shape's signed distance from the object; also writes its pose."""
    compose(own.frames[shapes.links[i]], shapes.poses[i], scratch.pose)
    return least_distance(moved(scratch.pose, shapes.boxes[i]), surface)[0] - shapes.boxes[i, 6]


@part
def _raise(i, row, least, shapes, surface, own, scratch):
    """Write a better bound of a shape's gap: a rough one above `least`, else the gap itself."""
    gap = _least_gap(i, shapes, surface, own, scratch)
    own.measured[row, i] = gap <= least
    if gap <= least:
        gap = min(shape_gap(i, shapes.first_sample[i], FAR, shapes, surface, scratch), FAR)
    own.gaps[row, i] = gap


@part
def _apart(i, j, shapes, own):
    """Lower bound of the distance of two shapes: 0 if near; if negative, minus their overlap."""
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
    """Write the gaps and distances at the start of closing."""
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
        if apart[n] < -OVERLAPS:  # these links may go deeper, for instance on their way out
            for k in range(pairs.shape[0]):
                if (
                    links[pairs[k, 0]] == links[pairs[n, 0]]
                    and links[pairs[k, 1]] == links[pairs[n, 1]]
                ):
                    apart[k] = math.inf


@part
def _stop(i, j, closing, pace):
    """Stop the joints that move i (j < 0), or only one of i and j; return whether any moved."""
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
    """Times for which the joints may move: safely, and at most, with the step perhaps repeated.

    If the gap of the shape that limits the time most is not measured yet, it is measured here.
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
    """Find the pair that collides after a step (-1 if none) and write the distances after it."""
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
    """Predict the share of a step after which no shape is too deep; write the gaps after it."""
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
    """Move the joints one step; return the longest time of the next step, 0 if all have stopped."""
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

    All joints move at their speeds. A lower bound of each shape's gap is reduced by the distance it
    may have moved, and measured again when it is used up. Pairs of shapes are treated likewise.

    Args:
        poses: Hand's frame to that of the object [m] (k, 4, 4).
        postures: Postures from which the hands close, replaced by those at which they stop (k, p).
        begin: First pose.
        end: One past the last pose.
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
