"""Overlaps of the links of a hand with each other."""

import math

import numpy as np

from grasp3d._kernels.compiling import kernel, part
from grasp3d._kernels.hands.link_shapes import COARSE, point_depth
from grasp3d._kernels.hands.rigid_motions import compose, moved, moved_back, turned_back
from grasp3d._kernels.surface.vectors import copy, difference

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
