"""Jaws with inclined inner faces, by linear programming."""

import math

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog

from grasp3d import load_mesh
from grasp3d.hand.closing import close_jaws
from tests.helpers.closing_jaws import Floats, pads, random_poses

HALF_STROKE = 0.04

OUTLINE = 1e-3 * np.array([[0, 5], [0, -5], [-3, -30], [-15, -30], [-15, 5]])
"""Corners (x, z) of a finger of 20 mm with a pad of 10 mm, behind which it is inclined."""

FINGER = np.array([[x, y, z] for y in (-0.01, 0.01) for x, z in OUTLINE])


def first_touch(finger: Floats, solid: Floats) -> float:
    """How far a convex body moves along x until it touches another one, by linear programming.

    Both are the hulls of points. Of all pairs of their points that are on one line along x, that
    with the smallest distance touches; inf: there is none.
    """
    m, n = len(finger), len(solid)
    costs = np.concatenate([-finger[:, 0], solid[:, 0]])
    across = np.concatenate([finger[:, 1:], -solid[:, 1:]]).T
    sums = np.zeros((2, m + n))
    sums[0, :m] = sums[1, m:] = 1.0
    found = linprog(1e3 * costs, A_eq=np.vstack([1e3 * across, sums]), b_eq=[0, 0, 1, 1])
    return math.inf if found.fun is None else 1e-3 * float(found.fun)


@pytest.mark.parametrize("seed", range(4))
def test_jaws_touch_where_the_finger_does(seed: int) -> None:
    faces = tuple(
        ((x, -0.01, z), (x, 0.01, z), (to, 0.01, end), (to, -0.01, end))
        for (x, z), (to, end) in zip(OUTLINE[:2].tolist(), OUTLINE[1:3].tolist(), strict=True)
    )
    hand = pads(inner_faces=faces, compliance=0.0, finger_thickness=0.015)
    body = trimesh.convex.convex_hull(np.random.default_rng(seed).normal(size=(20, 3)) * 0.008)
    poses = random_poses(12, 0.008, seed)
    found = close_jaws(load_mesh(body, unit="m", max_edge=1.0), poses, hand)
    assert found.closed.any()
    for row, matrix in enumerate(poses):
        local = (body.vertices - matrix[:3, 3]) @ matrix[:3, :3]
        ways = [first_touch(FINGER, local * [side, 1.0, 1.0]) for side in (1.0, -1.0)]
        reaches = min(ways) > -HALF_STROKE and sum(ways) < 0.0  # it starts outside the object
        assert found.closed[row] == reaches
        if reaches:
            assert found.opening[row] == pytest.approx(-sum(ways), abs=2e-7)
